//! `backlash`: play between the muscle and its encoder.
//!
//! It changes what is read and not what the muscle does, so the term is one of the sensors. A
//! measured contraction that is an input is taken as it is: see `SensorBlock::truth`.

use super::{EffectKind, Form, Parameter};
use crate::plant::Term;
use crate::plant::sensors::{Reading, SensorPoint, SensorTerm};
use crate::plant::term::Dynamics;

const PLAY_M: Parameter = Parameter::new("play_m", "m", (0.0, 5e-2), 1e-3).neutral(0.0);

pub(super) const KIND: EffectKind = EffectKind {
    name: "backlash",
    block: "load",
    mark: "The contraction lags a reversal by a fixed distance; force and pressure do not.",
    experiment: "small triangles about one place with a dial gauge at the load; the encoder stands \
                 still for the play.",
    forms: &[
        Form {
            name: "play",
            parameters: &[PLAY_M],
            source: "A play operator (Tao & Kokotović 1996) whose encoder starts in the middle of \
                     its play. Leaves out friction and inertia of the encoder, and play that \
                     the load's own motion passes.",
            build: |values| backlash(values[0], 0.0),
        },
        Form {
            name: "play-from-a-side",
            parameters: &[PLAY_M, Parameter::new("start", "1", (-1.0, 1.0), -1.0)],
            source: "The same with the place from which the encoder starts: −1 where the muscle \
                     takes it along at once when it contracts, 1 when it pays out.",
            build: |values| backlash(values[0], values[1]),
        },
    ],
};

fn backlash(play_m: f64, start: f64) -> Term {
    Term::Sensor(Box::new(Backlash { play_m, start }))
}

/// The state is what the encoder reads.
struct Backlash {
    play_m: f64,
    /// Where in its play the encoder starts, from −1 to 1.
    start: f64,
}

impl Backlash {
    fn read(&self, at: &SensorPoint, encoder: f64) -> f64 {
        let half = self.play(at.initial_length_m);
        encoder.clamp(at.truth.contraction - half, at.truth.contraction + half)
    }
}

impl Dynamics<SensorPoint> for Backlash {
    fn states(&self) -> usize {
        1
    }

    fn settle(&self, at: &SensorPoint, state: &mut [f64]) {
        let half = self.play(at.initial_length_m);
        state[0] = at.truth.contraction + self.start * half;
    }

    fn commit(&self, at: &SensorPoint, state: &mut [f64]) {
        state[0] = self.read(at, state[0]);
    }
}

impl SensorTerm for Backlash {
    fn read(&self, at: &SensorPoint, state: &[f64], reading: &mut Reading) {
        // What another sensor effect has added stays on top.
        reading.contraction += self.read(at, state[0]) - at.truth.contraction;
    }

    fn play(&self, initial_length_m: f64) -> f64 {
        0.5 * self.play_m / initial_length_m
    }
}
