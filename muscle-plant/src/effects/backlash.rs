//! `backlash`: play between the muscle and its encoder.
//!
//! It changes the reading and not the motion, so that the term is one of the sensors. A measured
//! contraction that is an input is used as it was read: see `SensorSubsystem::truth`.

use super::{
    CompensationMethod, DISCREPANCY_RATIO, EffectKind, Equation, Form, Observation, Parameter,
    Requirement,
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
    requires: &[Requirement::Motion],
    signature: "The contraction lags a reversal by a fixed distance; force and pressure do not.",
    test_signal: "small triangles about one position with a dial gauge at the load; the encoder \
                  stands still within the play.",
    discrepancy_ratio: DISCREPANCY_RATIO,
    compensation: CompensationMethod::Unavailable(
        "the encoder does not read the motion within the backlash, so the controller cannot react \
         to it",
    ),
    forms: &[
        Form {
            name: "play",
            parameters: &[PLAY_M],
            source: "A play operator (Tao & Kokotović 1996) with the encoder in the middle of the \
                     play at first. Leaves out friction and inertia of the encoder, and play \
                     between muscle and load.",
            build: |values| Term::Sensor(Box::new(play(values))),
            observation: Some(|values| Box::new(play(values))),
        },
        Form {
            name: "play-from-a-side",
            parameters: &[PLAY_M, START],
            source: "The same with the initial position of the encoder in the play: at −1 it moves \
                     at once when the muscle contracts, at 1 when it extends. Leaves out the same.",
            build: |values| Term::Sensor(Box::new(play_from_a_side(values))),
            observation: Some(|values| Box::new(play_from_a_side(values))),
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
            source: "A sum of two plays (Prandtl–Ishlinskii) with the given one as their mean: a \
                     share of the reading has a play that is larger than the rest's by the grade \
                     times the mean, as with a compliant coupling. Leaves out more than two \
                     stages.",
            build: |values| Term::Sensor(Box::new(graded(values))),
            observation: Some(|values| Box::new(graded(values))),
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
    use super::*;
    use model_core::pressure::GaugePa;

    /// A wave whose turns pass the plays, some only the near one.
    #[test]
    fn the_near_share_is_what_is_left_without_the_further_play() {
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
        let found = loose
            .without_further_backlash(0.3, &read)
            .expect("further play");
        let apart = |a: &[f64], b: &[f64]| {
            let gaps = a.iter().zip(b).map(|(a, b)| (a - b).abs());
            gaps.fold(0.0, f64::max)
        };
        assert!(apart(&found, &near) < 1e-12, "{}", apart(&found, &near));
        assert!(apart(&read, &near) > 4e-4, "{}", apart(&read, &near));
        // Of a play that is not graded nothing is left to take off.
        let plain = Backlash {
            grade: 0.0,
            ..loose
        };
        assert!(plain.without_further_backlash(0.3, &read).is_none());
    }
}
