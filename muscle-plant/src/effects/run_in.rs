//! `run-in`: the first cycles after mounting or a rest are softer or stiffer.

use super::{EffectKind, Form, Parameter};
use crate::subsystem::Term;
use crate::subsystem::muscle::{MusclePoint, MuscleTerm};
use crate::subsystem::term::Dynamics;
use model_core::muscle::Muscle;

const SHARE: Parameter = Parameter::new("share", "1", (-0.5, 0.5), 0.05).neutral(0.0);
/// What takes longer than some thirty cycles is, of the first few, a gain of the force.
const DISTANCE: Parameter = Parameter::new("distance", "1", (1e-2, 20.0), 0.5)
    .log()
    .ends_at_max();

pub(super) const KIND: EffectKind = EffectKind {
    name: "run-in",
    place: "muscle-force",
    signature: "The residual falls from cycle to cycle, and not with time while the muscle rests.",
    test_signal: "twenty equal cycles after a rest of an hour; the change ends with cycles, not \
                 with \
                 time.",
    forms: &[
        Form {
            name: "exponential",
            parameters: &[SHARE, DISTANCE],
            source: "A share of the force that decays exponentially with the way travelled, in \
                     units of contraction: stress softening of rubber (Mullins 1969). Leaves out \
                     recovery during a rest, and motion within 0.001.",
            build: |values| run_in(values, f64::INFINITY, |ways| (-ways).exp()),
        },
        Form {
            name: "hyperbolic",
            parameters: &[SHARE, DISTANCE],
            source: "A share of the force that falls as 1/(1 + way/distance): quick at first, then \
                     long. Leaves out recovery during a rest.",
            build: |values| run_in(values, f64::INFINITY, |ways| 1.0 / (1.0 + ways)),
        },
        Form {
            name: "cyclic",
            parameters: &[
                SHARE,
                Parameter::new("cycles", "1", (0.1, 30.0), 2.0)
                    .log()
                    .ends_at_max(),
            ],
            source: "A share of the force that decays exponentially with the cycles, of which all \
                     of more than 0.02 of contraction count the same: half of each is done in \
                     the first 0.02 after a turn. Leaves out recovery during a rest.",
            build: |values| {
                let distance = 2.0 * STROKE * values[1];
                run_in(&[values[0], distance], STROKE, |ways| (-ways).exp())
            },
        },
    ],
};

fn run_in(values: &[f64], stroke: f64, left: fn(f64) -> f64) -> Term {
    Term::Muscle(Box::new(RunIn {
        share: values[0],
        distance: values[1],
        stroke,
        left,
    }))
}

/// Half the play within which a motion is none: where the contraction is measured, its noise would
/// otherwise be a way without end.
const PLAY: f64 = 5e-4;
/// The least stroke that is half a cycle; what is shorter, as of an arm held still, is less of one.
const STROKE: f64 = 0.02;

/// The states are the place of the play, the way that it was moved as far as it counts, and its way
/// since it last turned, with its sign.
struct RunIn {
    share: f64,
    distance: f64,
    /// How much of the way from one turn to the next counts.
    stroke: f64,
    /// What is left of the effect after so many distances.
    left: fn(f64) -> f64,
}

impl RunIn {
    fn moved(&self, at: &MusclePoint, state: &[f64]) -> [f64; 3] {
        // Not `clamp`, which refuses the NaN that a trial step may hold.
        let place = state[0]
            .max(at.contraction - PLAY)
            .min(at.contraction + PLAY);
        let step = place - state[0];
        let before = if step * state[2] < 0.0 { 0.0 } else { state[2] };
        let since = before + step;
        let counts = |way: f64| way.abs().min(self.stroke);
        [place, state[1] + counts(since) - counts(before), since]
    }

    fn left_at(&self, at: &MusclePoint, state: &[f64]) -> f64 {
        (self.left)(self.moved(at, state)[1] / self.distance)
    }
}

impl Dynamics<MusclePoint> for RunIn {
    fn states(&self) -> usize {
        3
    }

    fn steady_state(&self, at: &MusclePoint, state: &mut [f64]) {
        state.copy_from_slice(&[at.contraction, 0.0, 0.0]);
    }

    fn accept_step(&self, at: &MusclePoint, state: &mut [f64]) {
        let moved = self.moved(at, state);
        state.copy_from_slice(&moved);
    }
}

impl MuscleTerm for RunIn {
    fn force_n(&self, at: &MusclePoint, _: &Muscle<f64>, state: &[f64], force_n: f64) -> f64 {
        force_n * (1.0 + self.share * self.left_at(at, state))
    }

    // Who has run in a little already, over a way that nobody has measured, has less of it left.
    fn fading(&self, at: &MusclePoint, muscle: &Muscle<f64>, state: &[f64]) -> Vec<(f64, f64)> {
        let force_n = muscle.force_n(at.contraction, at.pressure);
        let size_n = force_n * self.share * self.left_at(at, state);
        vec![(size_n, f64::INFINITY)]
    }
}
