//! `backlash`: play between the muscle and its encoder.
//!
//! It changes what is read and not what the muscle does, so the term is one of the sensors. A
//! measured contraction that is an input is taken as it is: see `SensorSubsystem::truth`.

use super::{EffectKind, Form, Parameter};
use crate::subsystem::Term;
use crate::subsystem::sensors::{Reading, SensorPoint, SensorTerm};
use crate::subsystem::term::Dynamics;

const PLAY_M: Parameter = Parameter::new("play_m", "m", (0.0, 5e-2), 1e-3).neutral(0.0);

const START: Parameter = Parameter::new("start", "1", (-1.0, 1.0), -1.0);

pub(super) const KIND: EffectKind = EffectKind {
    name: "backlash",
    place: "load",
    signature: "The contraction lags a reversal by a fixed distance; force and pressure do not.",
    test_signal: "small triangles about one place with a dial gauge at the load; the encoder stands \
                 still for the play.",
    forms: &[
        Form {
            name: "play",
            parameters: &[PLAY_M],
            source: "A play operator (Tao & Kokotović 1996) whose encoder starts in the middle of \
                     its play. Leaves out friction and inertia of the encoder, and play that \
                     the load's own motion passes.",
            build: |values| backlash(values[0], UNGRADED, 0.0),
        },
        Form {
            name: "play-from-a-side",
            parameters: &[PLAY_M, START],
            source: "The same with the place from which the encoder starts: −1 where the muscle \
                     takes it along at once when it contracts, 1 when it pays out.",
            build: |values| backlash(values[0], UNGRADED, values[1]),
        },
        Form {
            name: "graded",
            parameters: &[
                PLAY_M,
                // The nearer play is none at the largest of both.
                Parameter::new("grade", "1", (0.0, 1.25), 0.5),
                Parameter::new("far_share", "1", (0.2, 0.8), 0.5),
                START,
            ],
            source: "A sum of two plays (Prandtl–Ishlinskii), this one on average: a share of the \
                     reading has farther to go than the rest, by the grade times it, as where a \
                     coupling yields before all is taken along. Leaves out more stages than two.",
            build: |values| backlash(values[0], (values[1], values[2]), values[3]),
        },
    ],
};

/// Grade and far share of a play that is one.
const UNGRADED: (f64, f64) = (0.0, 0.5);

fn backlash(play_m: f64, (grade, far_share): (f64, f64), start: f64) -> Term {
    Term::Sensor(Box::new(Backlash {
        play_m,
        grade,
        far_share,
        start,
    }))
}

/// The states are what the two shares of the encoder read.
struct Backlash {
    /// On average over both.
    play_m: f64,
    /// By how much the plays differ, in units of `play_m`.
    grade: f64,
    far_share: f64,
    /// Where in its play the encoder starts, from −1 to 1.
    start: f64,
}

impl Backlash {
    /// How far each share may be behind, either way \[-\].
    fn reach(&self, initial_length_m: f64) -> [f64; 2] {
        let half = 0.5 * self.play_m / initial_length_m;
        let near = 1.0 - self.far_share * self.grade;
        [near, near + self.grade].map(|ratio| half * ratio)
    }

    fn shares(&self, at: &SensorPoint, state: &[f64]) -> [f64; 2] {
        let [near, far] = self.reach(at.initial_length_m);
        [
            dragged(state[0], at.truth.contraction, near),
            dragged(state[1], at.truth.contraction, far),
        ]
    }
}

/// A play operator: what `read` becomes as it is taken along by `place`.
fn dragged(read: f64, place: f64, reach: f64) -> f64 {
    // Not `clamp`, which refuses the NaN of a gap.
    read.max(place - reach).min(place + reach)
}

impl Dynamics<SensorPoint> for Backlash {
    fn states(&self) -> usize {
        2
    }

    fn steady_state(&self, at: &SensorPoint, state: &mut [f64]) {
        let reach = self.reach(at.initial_length_m);
        for (state, reach) in state.iter_mut().zip(reach) {
            *state = at.truth.contraction + self.start * reach;
        }
    }

    fn accept_step(&self, at: &SensorPoint, state: &mut [f64]) {
        state.copy_from_slice(&self.shares(at, state));
    }
}

impl SensorTerm for Backlash {
    fn read(&self, at: &SensorPoint, state: &[f64], reading: &mut Reading) {
        let [near, far] = self.shares(at, state);
        let read = near + self.far_share * (far - near);
        // What another sensor effect has added stays on top.
        reading.contraction += read - at.truth.contraction;
    }

    fn play(&self, initial_length_m: f64) -> f64 {
        self.reach(initial_length_m)[0]
    }

    /// The inverse of the sum of two plays is one, too: what the near share reads, u, drags the far
    /// one, and y = (1 − s) u + s P_d(u) gives u = (y − s P_(1−s)d(y)) / (1 − s) (Krejčí & Kuhnen
    /// 2001).
    fn without_further_play(&self, initial_length_m: f64, read: &[f64]) -> Option<Vec<f64>> {
        let [near, far] = self.reach(initial_length_m);
        let (share, rest) = (self.far_share, 1.0 - self.far_share);
        let reach = rest * (far - near);
        let first = read.iter().find(|read| !read.is_nan())?;
        if reach == 0.0 {
            return None;
        }
        let mut behind = first + self.start * reach;
        let near = read.iter().map(|read| {
            behind = dragged(behind, *read, reach);
            (read - share * behind) / rest
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
        for at in (0..600).map(point) {
            loose.accept_step(&at, &mut state);
            let mut reading = at.truth;
            SensorTerm::read(&loose, &at, &state, &mut reading);
            near.push(state[0]);
            read.push(reading.contraction);
        }
        let found = loose
            .without_further_play(0.3, &read)
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
        assert!(plain.without_further_play(0.3, &read).is_none());
    }
}
