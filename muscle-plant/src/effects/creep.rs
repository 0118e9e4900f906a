//! `creep`: the rubber takes time to take up its share of a new pressure or length.
//!
//! Each form is a sum of relaxations (standard linear solids): right after a change the muscle
//! pulls less than Eq 1 says if it was upward, and comes to Eq 1 with time.

use super::{EffectKind, Form, Parameter, REFERENCE_CONTRACTION, REFERENCE_PRESSURE_PA, lagged};
use crate::subsystem::Term;
use crate::subsystem::muscle::{MusclePoint, MuscleTerm};
use crate::subsystem::term::Dynamics;
use model_core::muscle::Muscle;

const FORCE_N: Parameter = Parameter::new("force_n", "N", (0.0, 1e3), 15.0).neutral(0.0);
// Faster than this is a line's lag, or the gas's heat.
const TIME_CONSTANT_S: Parameter = Parameter::new("time_constant_s", "s", (0.3, 1e3), 5.0)
    .log()
    .ends_at_min();

/// Sizes and time constants of two relaxations, the first of which may be the only one.
const TWO: [Parameter; 4] = [
    Parameter::new("force_n", "N", (0.0, 1e3), 8.0).neutral(0.0),
    Parameter::new("time_constant_s", "s", (0.3, 1e3), 1.0).log(),
    Parameter::new("second_force_n", "N", (0.0, 1e3), 8.0).neutral(0.0),
    Parameter::new("second_time_constant_s", "s", (0.3, 1e4), 15.0).log(),
];

pub(super) const KIND: EffectKind = EffectKind {
    name: "creep",
    place: "muscle-force",
    signature: "A slow drift after a step with the pressure held, of the step's sign, over 1 to 60 s.",
    test_signal: "a step up and one down, each held for 60 s with the valve working.",
    forms: &[
        Form {
            name: "relaxation",
            parameters: &[FORCE_N, TIME_CONSTANT_S],
            source: "One relaxation of the pressure, which acts through the braid, its size at a \
                     step of 300 kPa without contraction; Tondu 2012. Leaves out the decades a \
                     rubber's relaxation spans.",
            build: |values| relaxations(vec![(values[0], values[1])], BY_PRESSURE),
        },
        Form {
            name: "two-relaxations",
            parameters: &TWO,
            source: "Two relaxations of the pressure, their sizes at a step of 300 kPa. Leaves out \
                     the decades a rubber's relaxation spans.",
            build: |values| relaxations(pair(values), BY_PRESSURE),
        },
        Form {
            name: "logarithmic",
            parameters: &[Parameter::new("force_per_decade_n", "N", (0.0, 1e3), 10.0).neutral(0.0)],
            source: "Drift in proportion to the logarithm of time after a step of 300 kPa, as \
                     rubber shows (Gent 1962), by relaxations a decade apart from 0.5 to 500 s. \
                     Leaves out what is over before 0.2 s or begins after 1000 s.",
            build: |values| {
                let branches = LOGARITHMIC_TIME_CONSTANTS_S.map(|time_s| (values[0], time_s));
                relaxations(branches.to_vec(), BY_PRESSURE)
            },
        },
        Form {
            name: "strain-relaxation",
            parameters: &[FORCE_N, TIME_CONSTANT_S],
            source: "One relaxation of the bladder's strain, in parallel with Eq 1 (Zener), its \
                     size at a step of 0.25 in contraction. Leaves out what a step of the \
                     pressure alone leaves behind.",
            build: |values| relaxations(vec![(values[0], values[1])], BY_STRAIN),
        },
        Form {
            name: "two-strain-relaxations",
            parameters: &TWO,
            source: "Two relaxations of the bladder's strain, in parallel with Eq 1 (generalized \
                     Maxwell), their sizes at a step of 0.25 in contraction. Leaves out what a \
                     step of the pressure alone leaves behind.",
            build: |values| relaxations(pair(values), BY_STRAIN),
        },
        Form {
            name: "logarithmic-strain",
            parameters: &[
                Parameter::new("force_per_decade_n", "N", (0.0, 1e3), 15.0).neutral(0.0),
                Parameter::new("shortest_time_constant_s", "s", (0.1, 3.0), 0.3).log(),
                Parameter::new("longest_time_constant_s", "s", (1.0, 1e5), 200.0).log(),
            ],
            source: "Relaxation of the bladder's strain in proportion to the logarithm of time, \
                     as rubber shows (Gent 1962), its size in a decade after a step of 0.25 in \
                     contraction: four branches of equal size, evenly from the shortest to the \
                     longest time constant. Leaves out what a step of the pressure alone leaves \
                     behind.",
            build: |values| relaxations(evenly(values[0], values[1], values[2]), BY_STRAIN),
        },
    ],
};

/// Time constants of the logarithmic form \[s\].
const LOGARITHMIC_TIME_CONSTANTS_S: [f64; 4] = [0.5, 5.0, 50.0, 500.0];

fn pair(values: &[f64]) -> Vec<(f64, f64)> {
    vec![(values[0], values[1]), (values[2], values[3])]
}

/// Branches of the logarithmic form of the strain: a decade apart they ripple by 2 % of its size.
const BRANCHES: u32 = 4;

/// Branches evenly over the logarithm of time, together `per_decade_n` in each decade.
fn evenly(per_decade_n: f64, shortest_s: f64, longest_s: f64) -> Vec<(f64, f64)> {
    let ratio = (longest_s / shortest_s).powf(1.0 / f64::from(BRANCHES - 1));
    let size_n = per_decade_n * ratio.log10().abs();
    let time_s = |branch| shortest_s * ratio.powf(f64::from(branch));
    let branches = (0..BRANCHES).map(|branch| (size_n, time_s(branch)));
    branches.collect()
}

/// What the states follow, and how it pulls at a contraction.
#[derive(Clone, Copy)]
struct Drive {
    value: fn(&MusclePoint) -> f64,
    share: fn(&MusclePoint, &Muscle<f64>) -> f64,
}

/// Pressure that the bladder does not pass on yet acts through the braid, as in Eq 1.
const BY_PRESSURE: Drive = Drive {
    value: |at| at.pressure.0 / REFERENCE_PRESSURE_PA,
    share: |at, muscle| {
        muscle.force_per_pressure_m2(at.contraction) / muscle.force_per_pressure_m2(0.0)
    },
};

const BY_STRAIN: Drive = Drive {
    value: |at| at.contraction / REFERENCE_CONTRACTION,
    share: |_, _| 1.0,
};

fn relaxations(branches: Vec<(f64, f64)>, drive: Drive) -> Term {
    Term::Muscle(Box::new(Relaxations { branches, drive }))
}

/// The states follow the drive with the branches' time constants.
struct Relaxations {
    /// Size \[N\] at a drive of 1 and no contraction, and time constant \[s\].
    branches: Vec<(f64, f64)>,
    drive: Drive,
}

impl Dynamics<MusclePoint> for Relaxations {
    fn states(&self) -> usize {
        self.branches.len()
    }

    fn steady_state(&self, at: &MusclePoint, state: &mut [f64]) {
        state.fill((self.drive.value)(at));
    }

    fn rates(&self, at: &MusclePoint, state: &[f64], rates: &mut [f64]) {
        let drive = (self.drive.value)(at);
        for (i, (_, time_constant_s)) in self.branches.iter().enumerate() {
            rates[i] = (drive - state[i]) / time_constant_s;
        }
    }

    fn propagate(&self, from: &MusclePoint, to: &MusclePoint, state: &mut [f64]) {
        let (length_s, drives) = (to.time_s - from.time_s, [from, to].map(self.drive.value));
        for (state, (_, time_constant_s)) in state.iter_mut().zip(&self.branches) {
            *state = lagged(*state, drives, length_s, *time_constant_s);
        }
    }
}

impl MuscleTerm for Relaxations {
    fn force_n(&self, at: &MusclePoint, muscle: &Muscle<f64>, state: &[f64], force_n: f64) -> f64 {
        let drive = (self.drive.value)(at);
        let branches = self.branches.iter().zip(state);
        let missing_n = branches.map(|((size_n, _), state)| size_n * (drive - state));
        force_n - (self.drive.share)(at, muscle) * missing_n.sum::<f64>()
    }

    fn fading(&self, at: &MusclePoint, muscle: &Muscle<f64>, _: &[f64]) -> Vec<(f64, f64)> {
        let share = (self.drive.share)(at, muscle);
        let branches = self.branches.iter();
        branches
            .map(|(size_n, time_s)| (size_n * share, *time_s))
            .collect()
    }
}
