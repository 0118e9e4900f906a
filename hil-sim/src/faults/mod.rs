//! The fault campaign: simulates the closed loop with one fault at a time, of every kind, size and
//! moment, and checks the motion and pressure against the bounds of docs/safety.md.
//!
//! Seed and number determine a case on any machine.

pub mod ablation;
pub mod bounds;
pub mod campaign;
mod instruments;
pub mod kind;
pub mod memory;
pub mod outcome;
mod plant;
pub mod report;
pub mod run;
pub mod unit;

use crate::bench::person::{CHECKED_S, Finger};
use crate::rig::Rig;
use kind::{Inject, KINDS, Kind};
use muscle_plant::effects::{Effect, slack};
use muscle_plant::nominal::Load;
use outcome::END_S;
pub use plant::Hardware;
use rand::{Rng, RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;
use serde::Serialize;

/// The phase of a run in which the fault occurs.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Moment {
    /// Before the controller starts.
    Start,
    /// After the self-check, before assistance is requested.
    Ready,
    /// Assisting, while the weight is still on its stop.
    Rest,
    /// While the weight is lifted.
    Lifting,
    /// While the weight is held.
    Holding,
    /// While the weight is lowered.
    Lowering,
    /// While a test signal is played, with the lever released.
    Playing,
}

impl Moment {
    /// All moments.
    pub const ALL: [Moment; 7] = [
        Moment::Start,
        Moment::Ready,
        Moment::Rest,
        Moment::Lifting,
        Moment::Holding,
        Moment::Lowering,
        Moment::Playing,
    ];
}

/// One case of the campaign.
#[derive(Clone, Debug)]
pub struct Case {
    /// Its number.
    pub number: u64,
    /// The kind of fault.
    pub kind: &'static Kind,
    /// The size of the fault, in the unit of the kind.
    pub size: f64,
    /// The phase in which the fault occurs.
    pub moment: Moment,
    /// Time of the fault \[s\].
    pub fault_s: f64,
    /// Time at which the lift, or the test signal, ends \[s\].
    pub used_s: f64,
    /// Time at which the case ends, unless a reason is latched later \[s\].
    pub ends_s: f64,
    /// The intended motion of the finger.
    pub finger: Finger,
    /// Stiffness of the person's arm \[N/m\].
    pub arm_stiffness_n_per_m: f64,
    /// Seed of the noise, and of random parts of the fault.
    pub seed: u64,
    /// The rig, with values drawn within their tolerances, and an effect if the case is healthy.
    pub rig: Rig,
    /// Hardware beside the controller.
    pub hardware: Hardware,
}

/// Earliest time at which assistance, or a test signal, is requested \[s\].
pub(crate) const REQUEST_S: f64 = 0.9;
/// Time that a case continues after the lift and after a latched reason \[s\]: 2.5 s in which the
/// reference falls from the highest pressure, three time constants of the slowest valve, and the
/// interval in which the final state is measured.
pub(crate) const AFTER_S: f64 = 2.5 + 3.0 * 0.3 + END_S;
/// The held part of a lift \[s\].
const HOLD_S: f64 = 0.8;

impl Case {
    /// Case `number` of the campaign with `seed`; its kind is `number` modulo the number of kinds.
    pub fn new(seed: u64, number: u64) -> Case {
        let kind = &KINDS[(number % KINDS.len() as u64) as usize];
        Case::of(kind, seed, number)
    }

    /// Case `number` of the campaign with `seed`, but with the given kind of fault.
    pub fn of(kind: &'static Kind, seed: u64, number: u64) -> Case {
        let mut random = Pcg64Mcg::seed_from_u64(seed ^ number.wrapping_mul(0x9E37_79B9_7F4A_7C15));
        let size = kind.sizes[random.random_range(0..kind.sizes.len())];
        let moment = Moment::ALL[random.random_range(0..Moment::ALL.len())];
        let rise_s = random.random_range(0.6..1.5);
        let share = random.random_range(0.05..1.0);
        let start_s = CHECKED_S + 0.4;
        let fault_s = match moment {
            Moment::Start => 0.0,
            Moment::Ready => REQUEST_S - 0.3 + 0.15 * share,
            Moment::Rest => CHECKED_S + 0.35 * share,
            Moment::Lifting => start_s + rise_s * share,
            Moment::Holding => start_s + rise_s + HOLD_S * share,
            Moment::Lowering => start_s + rise_s + HOLD_S + rise_s * share,
            Moment::Playing => start_s + (2.0 * rise_s + HOLD_S) * share,
        };
        let arms_n_per_m = [f64::INFINITY, 1500.0, 500.0];
        let used_s = start_s + 2.0 * rise_s + HOLD_S;
        let latched_within_s = kind.latched.map_or(0.0, |latched| (latched.within_s)(size));
        Case {
            number,
            kind,
            size,
            moment,
            fault_s,
            used_s,
            ends_s: used_s.max(fault_s + latched_within_s) + AFTER_S,
            finger: Finger::Lift {
                start_s,
                travel_m: random.random_range(0.06..0.12),
                rise_s,
                hold_s: HOLD_S,
                lower_s: rise_s,
            },
            arm_stiffness_n_per_m: arms_n_per_m[random.random_range(0..3)],
            seed: random.next_u64(),
            rig: rig(kind, &mut random),
            hardware: Hardware::None,
        }
    }

    /// The name of the fault, with its size if the kind has several.
    pub fn description(&self) -> String {
        let Kind { name, unit, .. } = self.kind;
        match self.kind.sizes {
            [_] => (*name).into(),
            _ => format!("{name} ({} {unit})", self.size),
        }
    }
}

/// The reference rig with values drawn within the tolerances of manufacturers (relative half
/// widths).
fn rig(kind: &Kind, random: &mut impl Rng) -> Rig {
    let mut rig = Rig::reference();
    let mut within = |value: &mut f64, relative: f64| {
        *value *= 1.0 + random.random_range(-relative..relative);
    };
    // The force of a muscle as supplied is within 2 %, the gain of a valve within 20 %.
    within(&mut rig.nominal.muscle.alpha_m2, 0.01);
    within(&mut rig.nominal.muscle.gamma_n, 0.02);
    if let Load::Weight(weight) = &mut rig.nominal.load {
        within(&mut weight.mass_kg, 0.02);
        within(&mut weight.viscous_damping_ns_per_m, 0.3);
        within(&mut weight.coulomb_friction_n, 0.3);
        weight.static_friction_n = 1.6 * weight.coulomb_friction_n;
    }
    if let Some(valve) = &mut rig.nominal.valve {
        within(&mut valve.flow_gain_kg_per_pa_s, 0.2);
    }
    if kind.inject == Inject::Healthy {
        let kinds: Vec<_> = rig.catalogue.kinds().collect();
        let effect = kinds[random.random_range(0..kinds.len())];
        let form = &effect.forms[random.random_range(0..effect.forms.len())];
        rig.effects.push(Effect::typical(effect, form));
    }
    // A rope does not push.
    let slack = Effect::typical(&slack::KIND, &slack::KIND.forms[0]);
    rig.effects.push(slack);
    rig
}
