//! A rig with hidden effects in the loop with somebody else's controller.

use rand::SeedableRng;
use rand_pcg::Pcg64;
use serde_json::Value;

use crate::effects::{Drawn, Form};
use crate::hidden::{Hidden, Reading};
use crate::machine::Machine;
use crate::record::STEP_S;
use crate::rig::Rig;

/// A rig, and what it hides.
#[derive(Clone, Copy)]
pub struct Hiding<'a> {
    /// The rig without effects.
    pub rig: &'a Rig,
    /// The effect's form and its size from 0, barely visible, to 1, plain; or none.
    pub effect: Option<(&'static Form, f64)>,
    /// Seed of what the size leaves open.
    pub seed: u64,
}

/// What there is to see when a controller looks.
#[derive(Clone, Copy, Debug)]
pub struct Seen {
    /// Since the beginning.
    pub time_s: f64,
    /// What the sensors show, without noise.
    pub reading: Reading,
    /// What is.
    pub truth: Reading,
}

impl Hiding<'_> {
    fn drawn(&self) -> Option<Drawn> {
        let rng = &mut Pcg64::seed_from_u64(self.seed);
        self.effect
            .map(|(form, size)| (form.draw)(size, self.rig, rng))
    }

    /// The hidden effect's numbers, as in an answer; null without one.
    #[must_use]
    pub fn parameters(&self) -> Value {
        self.drawn()
            .map_or(Value::Null, |drawn| drawn.parameters.clone())
    }

    /// Runs the vented rig from its stop. Every `period_s` `controller` looks and answers with the
    /// reference that the valve gets `late_s` later; it does so `ticks` times.
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
