//! `run-in`: the muscle is softer or stiffer in the first cycles after mounting or a rest.

use super::{
    CompensationMethod, DISCREPANCY_RATIO, DecayingForce, EffectKind, Equation, Form, Observation,
    Parameter, Quantity, Requirement,
};
use crate::subsystem::muscle::{MusclePoint, MuscleTerm};
use crate::subsystem::term::Dynamics;
use crate::subsystem::{Subsystem, Term};
use model_core::muscle::Muscle;

const SHARE: Parameter = Parameter::new("share", "1", (-0.5, 0.5), 0.05).neutral(0.0);
/// A change that takes more than some thirty cycles is a constant gain of the force in a record.
const DISTANCE: Parameter = Parameter::new("distance", "1", (1e-2, 20.0), 0.5)
    .log()
    .physical_max();

/// The kind, for the catalogue.
pub static KIND: EffectKind = EffectKind {
    name: "run-in",
    subsystem: Subsystem::MuscleForce,
    equations: &[Equation::MuscleForce],
    requires: &[Requirement::ThreeCycles],
    signature: "The residual falls from cycle to cycle, and not with time during a rest.",
    test_signal: "twenty equal cycles after a rest of an hour; the change ends with cycles, not \
                  with time.",
    discrepancy_ratio: DISCREPANCY_RATIO,
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
            name: "exponential",
            parameters: &[SHARE, DISTANCE],
            equation: "F = Eq 1 · (1 + share · exp(−s/distance)), s = ∫ |dε|",
            source: "A share of the force that decays exponentially with the distance moved, in \
                     units of contraction: stress softening of rubber (Mullins 1969).",
            leaves_out: "recovery during a rest, and motion within 0.001",
            build: &|values| Term::Muscle(Box::new(exponential(values))),
            observation: Some(&|values| Box::new(exponential(values))),
        },
        Form {
            name: "hyperbolic",
            parameters: &[SHARE, DISTANCE],
            equation: "F = Eq 1 · (1 + share/(1 + s/distance)), s = ∫ |dε|",
            source: "A share of the force that falls as 1/(1 + moved/distance): fast at first, \
                     then slowly.",
            leaves_out: "recovery during a rest, and motion within 0.001",
            build: &|values| Term::Muscle(Box::new(hyperbolic(values))),
            observation: Some(&|values| Box::new(hyperbolic(values))),
        },
        Form {
            name: "cyclic",
            parameters: &[
                SHARE,
                Parameter::new("cycles", "1", (0.1, 30.0), 2.0)
                    .log()
                    .physical_max(),
            ],
            equation: "F = Eq 1 · (1 + share · exp(−n/cycles)), n the cycles since the record \
                       began",
            source: "A share of the force that decays exponentially with the number of cycles; a \
                     stroke counts as half a cycle as soon as it exceeds 0.02 in contraction.",
            leaves_out: "recovery during a rest, and motion within 0.001",
            build: &|values| Term::Muscle(Box::new(cyclic(values))),
            observation: Some(&|values| Box::new(cyclic(values))),
        },
    ],
};

fn exponential(values: &[f64]) -> RunIn {
    RunIn {
        share: values[0],
        distance: values[1],
        stroke: f64::INFINITY,
        remaining: |distances| (-distances).exp(),
    }
}

fn hyperbolic(values: &[f64]) -> RunIn {
    RunIn {
        remaining: |distances| 1.0 / (1.0 + distances),
        ..exponential(values)
    }
}

fn cyclic(values: &[f64]) -> RunIn {
    RunIn {
        distance: 2.0 * STROKE * values[1],
        stroke: STROKE,
        ..exponential(values)
    }
}

/// Half-width of the band within which a motion does not count: the noise of a measured contraction
/// would otherwise add up without limit.
const HALF_BAND: f64 = 5e-4;
/// Smallest stroke that counts as half a cycle; a shorter one counts in proportion.
const STROKE: f64 = 0.02;

/// The states are the centre of the band, the distance by which it was moved as far as that counts,
/// and its displacement since it last turned.
struct RunIn {
    share: f64,
    distance: f64,
    /// Displacement after a turn up to which motion counts.
    stroke: f64,
    /// Share of the effect that remains after a number of distances.
    remaining: fn(f64) -> f64,
}

impl RunIn {
    fn moved(&self, point: &MusclePoint, state: &[f64]) -> [f64; 3] {
        // Not `clamp`, which panics on the NaN that a trial step may contain.
        let centre = state[0]
            .max(point.contraction - HALF_BAND)
            .min(point.contraction + HALF_BAND);
        let step = centre - state[0];
        let before = if step * state[2] < 0.0 { 0.0 } else { state[2] };
        let since = before + step;
        let counted = |displacement: f64| displacement.abs().min(self.stroke);
        [centre, state[1] + counted(since) - counted(before), since]
    }

    fn remaining_at(&self, point: &MusclePoint, state: &[f64]) -> f64 {
        (self.remaining)(self.moved(point, state)[1] / self.distance)
    }
}

impl Dynamics<MusclePoint> for RunIn {
    fn states(&self) -> usize {
        3
    }

    fn steady_state(&self, point: &MusclePoint, state: &mut [f64]) {
        state.copy_from_slice(&[point.contraction, 0.0, 0.0]);
    }

    fn accept_step(&self, point: &MusclePoint, state: &mut [f64]) {
        let moved = self.moved(point, state);
        state.copy_from_slice(&moved);
    }
}

impl MuscleTerm for RunIn {
    fn force_n(&self, point: &MusclePoint, _: &Muscle<f64>, state: &[f64], force_n: f64) -> f64 {
        force_n * (1.0 + self.share * self.remaining_at(point, state))
    }
}

impl Observation for RunIn {
    // Cycles before the record leave less of the effect, in the same proportion throughout.
    fn decaying_forces(
        &self,
        point: &MusclePoint,
        muscle: &Muscle<f64>,
        state: &[f64],
    ) -> Vec<DecayingForce> {
        let force_n = muscle.force_n(point.contraction, point.pressure);
        vec![DecayingForce {
            force_n: force_n * self.share * self.remaining_at(point, state),
            time_constant_s: f64::INFINITY,
        }]
    }
}

#[cfg(test)]
mod tests {
    use super::super::testing::{
        Inputs, STEP_S, added_n, assert_near, bench, effect, force_n, through,
    };
    use super::{HALF_BAND, KIND, STROKE};

    /// The share of the force that the effect adds, row by row.
    fn added_share(form: &str, values: &[(&str, f64)], inputs: &Inputs) -> Vec<f64> {
        let nominal_n = force_n(&[], inputs);
        added_n(&effect(&KIND, form, values), inputs)
            .iter()
            .zip(&nominal_n)
            .map(|(added_n, nominal_n)| added_n / nominal_n)
            .collect()
    }

    /// Two strokes with a rest between them, during which nothing changes, and one more.
    #[test]
    fn run_in_decays_with_the_distance_moved_and_not_with_time() {
        let path = [(0.0, 0.0), (1.0, 0.1), (2.0, 0.1), (3.0, 0.0), (4.0, 0.1)];
        let inputs = bench(STEP_S, 401, through(path), |_| 3e5);
        // Row, distance and number of cycles. Each reversal costs the whole band.
        let expected = [
            (0, 0.0, 0.0),
            (50, 0.05 - HALF_BAND, 0.5),
            (100, 0.1 - HALF_BAND, 0.5),
            (200, 0.1 - HALF_BAND, 0.5),
            (300, 0.2 - 3.0 * HALF_BAND, 1.0),
            (400, 0.3 - 5.0 * HALF_BAND, 1.5),
        ];
        let exponential = |relative: f64| (-relative).exp();
        let hyperbolic = |relative: f64| 1.0 / (1.0 + relative);
        for (form, key, remaining) in [
            ("exponential", "distance", exponential as fn(f64) -> f64),
            ("hyperbolic", "distance", hyperbolic),
            ("cyclic", "cycles", exponential),
        ] {
            let shares = added_share(form, &[("share", 0.05), (key, 0.2)], &inputs);
            for (row, distance, cycles) in expected {
                let moved = if form == "cyclic" { cycles } else { distance };
                assert_near(shares[row], 0.05 * remaining(moved / 0.2), 1e-6, form);
            }
        }
    }

    /// A rest does not end a stroke, and a stroke of less than 0.02 counts in proportion.
    #[test]
    fn run_in_counts_a_stroke_from_turn_to_turn() {
        let path = [
            (0.0, 0.0),
            (1.0, 0.01),
            (2.0, 0.01),
            (3.0, 0.05),
            (4.0, 0.04),
        ];
        let inputs = bench(STEP_S, 401, through(path), |_| 3e5);
        let shares = added_share("cyclic", &[("share", 0.05), ("cycles", 0.2)], &inputs);
        let first = 0.01 - HALF_BAND;
        let back = 0.01 - 2.0 * HALF_BAND;
        for (row, counted) in [
            (100, first),
            (200, first),
            (300, STROKE),
            (400, STROKE + back),
        ] {
            let cycles = counted / (2.0 * STROKE);
            assert_near(shares[row], 0.05 * (-cycles / 0.2).exp(), 1e-6, "cyclic");
        }
    }
}
