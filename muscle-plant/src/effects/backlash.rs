//! `backlash`: play between the muscle and its encoder.
//!
//! It changes the reading and not the motion, so that the term is one of the sensors. A measured
//! contraction that is an input is used as it was read: see `SensorSubsystem::truth`.

use super::{
    CompensationMethod, DISCREPANCY_RATIO, EffectKind, Equation, Form, Observation, Parameter,
    Quantity, Requirement,
};
use crate::subsystem::sensors::{Reading, SensorPoint, SensorTerm};
use crate::subsystem::term::Dynamics;
use crate::subsystem::{Subsystem, Term};

const PLAY_M: Parameter = Parameter::new("play_m", "m", (0.0, 5e-2), 1e-3).neutral(0.0);

const START: Parameter = Parameter::new("start", "1", (-1.0, 1.0), -1.0);

/// The kind, for the catalogue.
pub static KIND: EffectKind = EffectKind {
    name: "backlash",
    subsystem: Subsystem::Load,
    equations: &[Equation::Gas, Equation::MuscleForce, Equation::Load],
    requires: &[Requirement::Motion, Requirement::TwoReversals],
    signature: "The contraction lags a reversal by a fixed distance; force and pressure do not.",
    test_signal: "small triangles about one position with a dial gauge at the load; the encoder \
                  stands still within the play.",
    discrepancy_ratio: DISCREPANCY_RATIO,
    law_quantities: &[Quantity::Contraction],
    compensation: CompensationMethod::Unavailable(
        "the encoder does not read the motion within the backlash, so the controller cannot react \
         to it",
    ),
    forms: &[
        Form {
            name: "play",
            parameters: &[PLAY_M],
            equation: "The reading r stays within w = play_m/(2L) of ε: it stands still until ε \
                       reaches r ± w, and is then dragged along; r = ε at first",
            source: "A play operator (Tao & Kokotović 1996) with the encoder in the middle of the \
                     play at first.",
            leaves_out: "friction and inertia of the encoder, and play between muscle and load",
            build: &|values| Term::Sensor(Box::new(play(values))),
            observation: Some(&|values| Box::new(play(values))),
        },
        Form {
            name: "play-from-a-side",
            parameters: &[PLAY_M, START],
            equation: "The reading r stays within w = play_m/(2L) of ε: it stands still until ε \
                       reaches r ± w, and is then dragged along; r = ε + start · w at first",
            source: "The same with the initial position of the encoder in the play: at −1 it \
                     moves at once when the muscle contracts, at 1 when it extends.",
            leaves_out: "friction and inertia of the encoder, and play between muscle and load",
            build: &|values| Term::Sensor(Box::new(play_from_a_side(values))),
            observation: Some(&|values| Box::new(play_from_a_side(values))),
        },
        Form {
            name: "graded",
            parameters: &[
                PLAY_M,
                // With the largest values of both the smaller play is zero.
                Parameter::new("grade", "1", (0.0, 1.25), 0.5),
                Parameter::new("far_share", "1", (0.2, 0.8), 0.5),
                START,
            ],
            equation: "r = (1 − far_share) · r₁ + far_share · r₂; r₁ and r₂ are dragged along by \
                       ε with half-plays w₁ = (1 − far_share · grade) · w and w₂ = w₁ + grade · \
                       w, w = play_m/(2L), and are ε + start · wᵢ at first",
            source: "A sum of two plays (Prandtl–Ishlinskii) with the given one as their mean: a \
                     share of the reading has a play that is larger than the rest's by the grade \
                     times the mean, as with a compliant coupling.",
            leaves_out: "more than two stages",
            build: &|values| Term::Sensor(Box::new(graded(values))),
            observation: Some(&|values| Box::new(graded(values))),
        },
    ],
};

/// Grade and far share of a single play.
const UNGRADED: (f64, f64) = (0.0, 0.5);

fn backlash(play_m: f64, (grade, far_share): (f64, f64), start: f64) -> Backlash {
    Backlash {
        play_m,
        grade,
        far_share,
        start,
    }
}

fn play(values: &[f64]) -> Backlash {
    backlash(values[0], UNGRADED, 0.0)
}

fn play_from_a_side(values: &[f64]) -> Backlash {
    backlash(values[0], UNGRADED, values[1])
}

fn graded(values: &[f64]) -> Backlash {
    backlash(values[0], (values[1], values[2]), values[3])
}

/// The states are the readings of the two shares.
struct Backlash {
    /// Mean of both plays.
    play_m: f64,
    /// Difference of the plays, in units of `play_m`.
    grade: f64,
    far_share: f64,
    /// Initial position of the encoder in the play, from −1 to 1.
    start: f64,
}

impl Backlash {
    /// Half of each share's play \[-\].
    fn half_widths(&self, initial_length_m: f64) -> [f64; 2] {
        let half = 0.5 * self.play_m / initial_length_m;
        let near = 1.0 - self.far_share * self.grade;
        [near, near + self.grade].map(|ratio| half * ratio)
    }

    fn shares(&self, point: &SensorPoint, state: &[f64]) -> [f64; 2] {
        let [near, far] = self.half_widths(point.initial_length_m);
        [
            dragged(state[0], point.truth.contraction, near),
            dragged(state[1], point.truth.contraction, far),
        ]
    }
}

/// The play operator: the next reading after `read` with the input at `position`.
fn dragged(read: f64, position: f64, half_width: f64) -> f64 {
    // Not `clamp`, which panics on the NaN of a gap.
    read.max(position - half_width).min(position + half_width)
}

impl Dynamics<SensorPoint> for Backlash {
    fn states(&self) -> usize {
        2
    }

    fn steady_state(&self, point: &SensorPoint, state: &mut [f64]) {
        let half_widths = self.half_widths(point.initial_length_m);
        for (state, half_width) in state.iter_mut().zip(half_widths) {
            *state = point.truth.contraction + self.start * half_width;
        }
    }

    fn accept_step(&self, point: &SensorPoint, state: &mut [f64]) {
        state.copy_from_slice(&self.shares(point, state));
    }
}

impl SensorTerm for Backlash {
    fn read(&self, point: &SensorPoint, state: &[f64], reading: &mut Reading) {
        let [near, far] = self.shares(point, state);
        let read = near + self.far_share * (far - near);
        // Additive, to keep the changes of other effects on the sensor.
        reading.contraction += read - point.truth.contraction;
    }
}

impl Observation for Backlash {
    fn backlash(&self, initial_length_m: f64) -> f64 {
        self.half_widths(initial_length_m)[0]
    }

    /// The inverse of a sum of two plays is a sum of plays: the reading of the near share, u, is
    /// the input of the difference d of both, and y = (1 − s) u + s P_d(u) gives u = (y − s
    /// P_(1−s)d(y)) / (1 − s) (Krejčí & Kuhnen 2001).
    fn without_further_backlash(&self, initial_length_m: f64, read: &[f64]) -> Option<Vec<f64>> {
        let [near, far] = self.half_widths(initial_length_m);
        let (share, rest) = (self.far_share, 1.0 - self.far_share);
        let half_width = rest * (far - near);
        let first = read.iter().find(|read| !read.is_nan())?;
        if half_width == 0.0 {
            return None;
        }
        let mut dragged_reading = first + self.start * half_width;
        let near = read.iter().map(|read| {
            dragged_reading = dragged(dragged_reading, *read, half_width);
            (read - share * dragged_reading) / rest
        });
        Some(near.collect())
    }
}

#[cfg(test)]
mod tests {
    use super::super::testing::{
        CLAMPED, STEP_S, assert_near, bench, effect, force_n, largest_difference, run, through,
    };
    use super::*;
    use model_core::pressure::GaugePa;

    const LENGTH_M: f64 = CLAMPED.muscle.initial_length_m;

    #[test]
    fn backlash_is_a_play_operator_on_the_reading() {
        let path = [(0.0, 0.02), (1.0, 0.1), (2.0, 0.03), (3.0, 0.1)];
        let inputs = bench(STEP_S, 301, through(path), |_| 2e5);
        let half_width = 0.5 * 1.2e-3 / LENGTH_M;
        for (form, start) in [
            ("play", 0.0),
            ("play-from-a-side", -1.0),
            ("play-from-a-side", 1.0),
        ] {
            let mut parameters = vec![("play_m", 1.2e-3)];
            parameters.extend((form != "play").then_some(("start", start)));
            let loose = || [effect(&KIND, form, &parameters)];
            let mut expected = inputs.contraction[0] + start * half_width;
            let read = run(&CLAMPED, &loose(), &inputs).contraction;
            for (read, truth) in read.iter().zip(&inputs.contraction) {
                expected = expected.clamp(truth - half_width, truth + half_width);
                assert_near(*read, expected, 1e-12, form);
            }
            assert_eq!(force_n(&loose(), &inputs), force_n(&[], &inputs));
        }
    }

    /// The mean of both plays is the given one, and each follows its own operator.
    #[test]
    fn a_graded_backlash_is_a_sum_of_two() {
        let path = [
            (0.0, 0.02),
            (1.0, 0.1),
            (2.0, 0.097),
            (3.0, 0.1),
            (4.0, 0.03),
        ];
        let inputs = bench(STEP_S, 401, through(path), |_| 2e5);
        let (half_width, grade, far_share) = (0.5 * 1.2e-3 / LENGTH_M, 0.8, 0.3);
        let near = half_width * 0.76;
        let far = near + half_width * grade;
        assert_near(0.7 * near + 0.3 * far, half_width, 1e-15, "mean");
        let parameters = [
            ("play_m", 1.2e-3),
            ("grade", grade),
            ("far_share", far_share),
            ("start", 1.0),
        ];
        let loose = [effect(&KIND, "graded", &parameters)];
        let read = run(&CLAMPED, &loose, &inputs).contraction;
        let mut shares = [inputs.contraction[0] + near, inputs.contraction[0] + far];
        for (read, truth) in read.iter().zip(&inputs.contraction) {
            for (share, half_width) in shares.iter_mut().zip([near, far]) {
                *share = share.clamp(truth - half_width, truth + half_width);
            }
            assert_near(*read, 0.7 * shares[0] + 0.3 * shares[1], 1e-12, "graded");
        }
    }

    /// A wave with reversals that exceed both plays, and some that exceed the smaller one only.
    #[test]
    fn the_reading_of_the_near_share_is_recovered_from_a_graded_backlash() {
        let loose = Backlash {
            play_m: 1.2e-3,
            grade: 0.8,
            far_share: 0.3,
            start: -1.0,
        };
        let point = |row: i32| SensorPoint {
            time_s: 0.01 * f64::from(row),
            initial_length_m: 0.3,
            truth: Reading {
                pressure: GaugePa(2e5),
                contraction: 0.1
                    + 0.005 * (0.03 * f64::from(row)).sin()
                    + 0.002 * (0.2 * f64::from(row)).sin(),
                force_n: 0.0,
            },
        };
        let mut state = [0.0; 2];
        loose.steady_state(&point(0), &mut state);
        let (mut near, mut read) = (Vec::new(), Vec::new());
        for point in (0..600).map(point) {
            loose.accept_step(&point, &mut state);
            let mut reading = point.truth;
            SensorTerm::read(&loose, &point, &state, &mut reading);
            near.push(state[0]);
            read.push(reading.contraction);
        }
        let found = loose.without_further_backlash(0.3, &read);
        let found = found.expect("a graded backlash");
        let error = largest_difference(&found, &near);
        assert!(error < 1e-12, "{error}");
        assert!(largest_difference(&read, &near) > 4e-4);
        let plain = Backlash {
            grade: 0.0,
            ..loose
        };
        assert!(plain.without_further_backlash(0.3, &read).is_none());
    }
}
