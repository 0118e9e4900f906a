//! `run-in`: the first cycles after mounting or a rest are softer or stiffer.

use super::{EffectKind, Form, Parameter};
use crate::plant::Term;
use crate::plant::muscle::{MusclePoint, MuscleTerm};
use crate::plant::term::Dynamics;
use model_core::muscle::Muscle;

const SHARE: Parameter = Parameter::new("share", "1", (-0.5, 0.5), 0.05).neutral(0.0);
/// What takes longer than some thirty cycles is, of the first few, a gain of the force.
const DISTANCE: Parameter = Parameter::new("distance", "1", (1e-2, 20.0), 0.5).log();

pub(super) const KIND: EffectKind = EffectKind {
    name: "run-in",
    block: "muscle-force",
    mark: "The residual falls from cycle to cycle, and not with time while the muscle rests.",
    experiment: "twenty equal cycles after a rest of an hour; the change ends with cycles, not \
                 with \
                 time.",
    forms: &[
        Form {
            name: "exponential",
            parameters: &[SHARE, DISTANCE],
            source: "A share of the force that decays exponentially with the way travelled, in \
                     units of contraction: stress softening of rubber (Mullins 1969). Leaves out \
                     recovery during a rest, and motion within 0.001.",
            build: |values| run_in(values, |ways| (-ways).exp()),
        },
        Form {
            name: "hyperbolic",
            parameters: &[SHARE, DISTANCE],
            source: "A share of the force that falls as 1/(1 + way/distance): quick at first, then \
                     long. Leaves out recovery during a rest.",
            build: |values| run_in(values, |ways| 1.0 / (1.0 + ways)),
        },
    ],
};

fn run_in(values: &[f64], left: fn(f64) -> f64) -> Term {
    Term::Muscle(Box::new(RunIn {
        share: values[0],
        distance: values[1],
        left,
    }))
}

/// Half the play within which a motion is none: where the contraction is measured, its noise would
/// otherwise be a way without end.
const PLAY: f64 = 5e-4;

/// The states are the place of the play and the way that it was moved.
struct RunIn {
    share: f64,
    distance: f64,
    /// What is left of the effect after so many distances.
    left: fn(f64) -> f64,
}

impl RunIn {
    fn moved(&self, at: &MusclePoint, state: &[f64]) -> (f64, f64) {
        // Not `clamp`, which refuses the NaN that a trial step may hold.
        let place = state[0]
            .max(at.contraction - PLAY)
            .min(at.contraction + PLAY);
        (place, state[1] + (place - state[0]).abs())
    }

    fn left_at(&self, at: &MusclePoint, state: &[f64]) -> f64 {
        (self.left)(self.moved(at, state).1 / self.distance)
    }
}

impl Dynamics<MusclePoint> for RunIn {
    fn states(&self) -> usize {
        2
    }

    fn settle(&self, at: &MusclePoint, state: &mut [f64]) {
        state.copy_from_slice(&[at.contraction, 0.0]);
    }

    fn commit(&self, at: &MusclePoint, state: &mut [f64]) {
        (state[0], state[1]) = self.moved(at, state);
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
