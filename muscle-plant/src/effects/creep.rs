//! `creep`: the rubber relaxes after a change of pressure or length.
//!
//! Each form is a sum of relaxations (standard linear solids): right after an upward change the
//! muscle pulls less than Eq 1, and it approaches Eq 1 with time.

use super::{
    CompensationMethod, DecayingForce, EffectKind, Equation, Form, Observation, Parameter,
    Quantity, REFERENCE_CONTRACTION, REFERENCE_PRESSURE_PA, Requirement, lagged,
};
use crate::subsystem::muscle::{MusclePoint, MuscleTerm};
use crate::subsystem::term::Dynamics;
use crate::subsystem::{Subsystem, Term};
use model_core::muscle::Muscle;

const FORCE_N: Parameter = Parameter::new("force_n", "N", (0.0, 1e3), 15.0).neutral(0.0);
/// A faster relaxation is a lag of the line or the heat exchange of the gas.
const TIME_CONSTANT_S: Parameter = Parameter::new("time_constant_s", "s", (0.3, 1e3), 5.0)
    .log()
    .physical_min();

/// Sizes and time constants of two relaxations; the size of the second may be 0.
const TWO: [Parameter; 4] = [
    Parameter::new("force_n", "N", (0.0, 1e3), 8.0).neutral(0.0),
    Parameter::new("time_constant_s", "s", (0.3, 1e3), 1.0).log(),
    Parameter::new("second_force_n", "N", (0.0, 1e3), 8.0).neutral(0.0),
    Parameter::new("second_time_constant_s", "s", (0.3, 1e4), 15.0).log(),
];

/// The kind, for the catalogue.
pub static KIND: EffectKind = EffectKind {
    name: "creep",
    subsystem: Subsystem::MuscleForce,
    equations: &[Equation::MuscleForce],
    requires: &[Requirement::PressureHold],
    signature: "A slow drift with the sign of the step, over 1 to 60 s after it, with the pressure \
                held.",
    test_signal: "a step up and one down, each held for 60 s with the valve in operation.",
    discrepancy_ratio: 0.1,
    law_quantities: &[
        Quantity::Pressure,
        Quantity::Contraction,
        Quantity::ContractionRate,
    ],
    compensation: CompensationMethod::Unavailable(
        "it changes more slowly than a lift, and its present state is not measured",
    ),
    forms: &[
        Form {
            name: "relaxation",
            parameters: &[FORCE_N, TIME_CONSTANT_S],
            equation: "F = Eq 1 − force_n · f_p(ε)/f_p(0) · (p − s); ds/dt = (p − \
                       s)/time_constant_s, p = P/300 kPa, f_p = ∂F/∂P",
            source: "One relaxation of the pressure, which acts through the braid; its size is \
                     the force after a step of 300 kPa at no contraction. Tondu 2012.",
            leaves_out: "that the relaxation of rubber spans decades of time",
            build: &|values| Term::Muscle(Box::new(one(values, BY_PRESSURE))),
            observation: Some(&|values| Box::new(one(values, BY_PRESSURE))),
        },
        Form {
            name: "two-relaxations",
            parameters: &TWO,
            equation: "F = Eq 1 − f_p(ε)/f_p(0) · (force_n · (p − s₁) + second_force_n · (p − \
                       s₂)); ds₁/dt = (p − s₁)/time_constant_s, ds₂/dt = (p − \
                       s₂)/second_time_constant_s, p = P/300 kPa, f_p = ∂F/∂P",
            source: "Two relaxations of the pressure, with sizes at a step of 300 kPa.",
            leaves_out: "that the relaxation of rubber spans decades of time",
            build: &|values| Term::Muscle(Box::new(two(values, BY_PRESSURE))),
            observation: Some(&|values| Box::new(two(values, BY_PRESSURE))),
        },
        Form {
            name: "logarithmic",
            parameters: &[Parameter::new("force_per_decade_n", "N", (0.0, 1e3), 10.0).neutral(0.0)],
            equation: "F = Eq 1 − force_per_decade_n · f_p(ε)/f_p(0) · Σ (p − sᵢ); dsᵢ/dt = (p − \
                       sᵢ)/Tᵢ with Tᵢ = 0.5, 5, 50, 500 s, p = P/300 kPa, f_p = ∂F/∂P",
            source: "Drift proportional to the logarithm of time after a step of 300 kPa, as of \
                     rubber (Gent 1962), by relaxations a decade apart from 0.5 to 500 s.",
            leaves_out: "drift before 0.2 s and after 1000 s",
            build: &|values| Term::Muscle(Box::new(decades(values))),
            observation: Some(&|values| Box::new(decades(values))),
        },
        Form {
            name: "strain-relaxation",
            parameters: &[FORCE_N, TIME_CONSTANT_S],
            equation: "F = Eq 1 − force_n · (e − s); ds/dt = (e − s)/time_constant_s, e = ε/0.25",
            source: "One relaxation of the bladder's strain, in parallel with Eq 1 (Zener); its \
                     size is the force after a step of 0.25 in contraction.",
            leaves_out: "the relaxation after a step of pressure alone",
            build: &|values| Term::Muscle(Box::new(one(values, BY_STRAIN))),
            observation: Some(&|values| Box::new(one(values, BY_STRAIN))),
        },
        Form {
            name: "two-strain-relaxations",
            parameters: &TWO,
            equation: "F = Eq 1 − force_n · (e − s₁) − second_force_n · (e − s₂); ds₁/dt = (e − \
                       s₁)/time_constant_s, ds₂/dt = (e − s₂)/second_time_constant_s, e = ε/0.25",
            source: "Two relaxations of the bladder's strain, in parallel with Eq 1 (generalized \
                     Maxwell), with sizes at a step of 0.25 in contraction.",
            leaves_out: "the relaxation after a step of pressure alone",
            build: &|values| Term::Muscle(Box::new(two(values, BY_STRAIN))),
            observation: Some(&|values| Box::new(two(values, BY_STRAIN))),
        },
        Form {
            name: "logarithmic-strain",
            parameters: &[
                Parameter::new("force_per_decade_n", "N", (0.0, 1e3), 15.0).neutral(0.0),
                Parameter::new("shortest_time_constant_s", "s", (0.1, 3.0), 0.3).log(),
                Parameter::new("longest_time_constant_s", "s", (1.0, 1e5), 200.0).log(),
            ],
            equation: "F = Eq 1 − force_per_decade_n · lg r · Σ (e − sᵢ); dsᵢ/dt = (e − sᵢ)/Tᵢ \
                       with four Tᵢ from shortest_time_constant_s to longest_time_constant_s at \
                       equal ratios r, e = ε/0.25",
            source: "Relaxation of the bladder's strain proportional to the logarithm of time, as \
                     of rubber (Gent 1962); its size is the change of force per decade after a \
                     step of 0.25 in contraction. Four branches of equal size, at equal ratios \
                     from the shortest to the longest time constant.",
            leaves_out: "the relaxation after a step of pressure alone",
            build: &|values| Term::Muscle(Box::new(strain_decades(values))),
            observation: Some(&|values| Box::new(strain_decades(values))),
        },
    ],
};

/// Time constants of the logarithmic form \[s\].
const LOGARITHMIC_TIME_CONSTANTS_S: [f64; 4] = [0.5, 5.0, 50.0, 500.0];

/// One relaxation of a drive: size and time constant.
fn one(values: &[f64], drive: Drive) -> Relaxations {
    let branches = vec![(values[0], values[1])];
    Relaxations { branches, drive }
}

/// Two relaxations of a drive.
fn two(values: &[f64], drive: Drive) -> Relaxations {
    let branches = vec![(values[0], values[1]), (values[2], values[3])];
    Relaxations { branches, drive }
}

/// Relaxations of the pressure a decade apart.
fn decades(values: &[f64]) -> Relaxations {
    let branches = LOGARITHMIC_TIME_CONSTANTS_S.map(|time_s| (values[0], time_s));
    Relaxations {
        branches: branches.to_vec(),
        drive: BY_PRESSURE,
    }
}

/// Relaxations of the strain at equal ratios of time.
fn strain_decades(values: &[f64]) -> Relaxations {
    Relaxations {
        branches: evenly(values[0], values[1], values[2]),
        drive: BY_STRAIN,
    }
}

/// Branches of the logarithmic form of the strain: a decade apart, their sum deviates from the
/// logarithm by 2 % of its size.
const BRANCHES: u32 = 4;

/// Branches at equal ratios of time, with a sum of `per_decade_n` in each decade.
fn evenly(per_decade_n: f64, shortest_s: f64, longest_s: f64) -> Vec<(f64, f64)> {
    let ratio = (longest_s / shortest_s).powf(1.0 / f64::from(BRANCHES - 1));
    let size_n = per_decade_n * ratio.log10().abs();
    (0..BRANCHES)
        .map(|branch| (size_n, shortest_s * ratio.powf(f64::from(branch))))
        .collect()
}

/// The quantity that the states follow, and its share in the force at a contraction.
#[derive(Clone, Copy)]
struct Drive {
    value: fn(&MusclePoint) -> f64,
    share: fn(&MusclePoint, &Muscle<f64>) -> f64,
}

/// Pressure that the bladder does not transmit yet is missing in Eq 1.
const BY_PRESSURE: Drive = Drive {
    value: |point| point.pressure.0 / REFERENCE_PRESSURE_PA,
    share: |point, muscle| {
        muscle.force_per_pressure_m2(point.contraction) / muscle.force_per_pressure_m2(0.0)
    },
};

const BY_STRAIN: Drive = Drive {
    value: |point| point.contraction / REFERENCE_CONTRACTION,
    share: |_, _| 1.0,
};

/// The states follow the drive with the time constants of the branches.
struct Relaxations {
    /// Size \[N\] at a drive of 1 and no contraction, and time constant \[s\].
    branches: Vec<(f64, f64)>,
    drive: Drive,
}

impl Dynamics<MusclePoint> for Relaxations {
    fn states(&self) -> usize {
        self.branches.len()
    }

    fn steady_state(&self, point: &MusclePoint, state: &mut [f64]) {
        state.fill((self.drive.value)(point));
    }

    fn rates(&self, point: &MusclePoint, state: &[f64], rates: &mut [f64]) {
        let drive = (self.drive.value)(point);
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
    fn force_n(
        &self,
        point: &MusclePoint,
        muscle: &Muscle<f64>,
        state: &[f64],
        force_n: f64,
    ) -> f64 {
        let drive = (self.drive.value)(point);
        let branches = self.branches.iter().zip(state);
        let missing_n = branches.map(|((size_n, _), state)| size_n * (drive - state));
        force_n - (self.drive.share)(point, muscle) * missing_n.sum::<f64>()
    }
}

impl Observation for Relaxations {
    fn decaying_forces(
        &self,
        point: &MusclePoint,
        muscle: &Muscle<f64>,
        _: &[f64],
    ) -> Vec<DecayingForce> {
        let share = (self.drive.share)(point, muscle);
        self.branches
            .iter()
            .map(|(size_n, time_constant_s)| DecayingForce {
                force_n: size_n * share,
                time_constant_s: *time_constant_s,
            })
            .collect()
    }
}

#[cfg(test)]
mod tests;
