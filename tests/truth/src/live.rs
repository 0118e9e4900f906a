//! A rig with hidden effects in closed loop with an external controller.

use rand::SeedableRng;
use rand_pcg::Pcg64;
use serde_json::Value;

use crate::effects::{Drawn, Form};
use crate::hidden::{Hidden, Reading};
use crate::machine::Machine;
use crate::record::STEP_S;
use crate::rig::Rig;

/// A rig with a hidden effect.
#[derive(Clone, Copy)]
pub struct Hiding<'a> {
    /// The rig without effects.
    pub rig: &'a Rig,
    /// The effect's form and its size from 0, barely visible, to 1, plain; or none.
    pub effect: Option<(&'static Form, f64)>,
    /// Seed of the parameters that the size does not determine.
    pub seed: u64,
}

/// The rig at a sampling time of the controller.
#[derive(Clone, Copy, Debug)]
pub struct Seen {
    /// Time since the start.
    pub time_s: f64,
    /// Readings of the sensors, without noise.
    pub reading: Reading,
    /// True values.
    pub truth: Reading,
}

impl Hiding<'_> {
    fn drawn(&self) -> Option<Drawn> {
        let rng = &mut Pcg64::seed_from_u64(self.seed);
        self.effect
            .map(|(form, size)| (form.draw)(size, self.rig, rng))
    }

    /// The parameters of the hidden effect, as in an answer; null without one.
    #[must_use]
    pub fn parameters(&self) -> Value {
        self.drawn()
            .map_or(Value::Null, |drawn| drawn.parameters.clone())
    }

    /// Runs the vented rig from its stop for `ticks` periods. Every `period_s` `controller` returns
    /// the reference that the valve receives `late_s` later.
    pub fn run(
        &self,
        (period_s, late_s): (f64, f64),
        ticks: usize,
        mut controller: impl FnMut(&Seen) -> f64,
    ) {
        let drawn = self.drawn();
        let effects: Vec<&dyn Hidden> = drawn.iter().map(|drawn| drawn.hidden.as_ref()).collect();
        let mut machine = Machine::at_rest(self.rig, &effects, 0.0, 0.0);
        let steps = (period_s / STEP_S).round() as usize;
        let mut commands = vec![(f64::NEG_INFINITY, 0.0)];
        for tick in 0..ticks {
            let time_s = tick as f64 * period_s;
            let command_pa = controller(&Seen {
                time_s,
                reading: machine.reading(),
                truth: machine.truth(),
            });
            commands.push((time_s + late_s, command_pa));
            for step in 0..steps {
                let mut command_s = time_s + (step as f64 + 0.5) * STEP_S;
                for effect in &effects {
                    command_s = effect.command_time_s(command_s);
                }
                let sent = commands.partition_point(|(at_s, _)| *at_s <= command_s);
                machine.step(STEP_S, commands[sent - 1].1);
            }
        }
    }
}
