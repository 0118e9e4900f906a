//! `run-in`: the first cycles after mounting or a rest are softer or stiffer.

use super::{EffectKind, Form, Parameter};
use crate::plant::Term;
use crate::plant::muscle::{MusclePoint, MuscleTerm};
use crate::plant::term::Dynamics;
use model_core::muscle::Muscle;

const SHARE: Parameter = Parameter::new("share", "1", (-0.5, 0.5), 0.05).neutral(0.0);
const DISTANCE: Parameter = Parameter::new("distance", "1", (1e-2, 1e3), 0.5).log();

pub(super) const KIND: EffectKind = EffectKind {
    name: "run-in",
    block: "muscle-force",
    mark: "The residual falls from cycle to cycle, and not with time while the muscle rests.",
    forms: &[
        Form {
            name: "exponential",
            parameters: &[SHARE, DISTANCE],
            source: "A share of the force that decays exponentially with the way travelled, in \
                     units of contraction: stress softening of rubber (Mullins 1969). Leaves out \
                     recovery during a rest.",
            build: |values| run_in(values, |_| 1.0),
        },
        Form {
            name: "hyperbolic",
            parameters: &[SHARE, DISTANCE],
            source: "A share of the force that falls as 1/(1 + way/distance): quick at first, then \
                     long. Leaves out recovery during a rest.",
            build: |values| run_in(values, |left| left),
        },
    ],
};

fn run_in(values: &[f64], pace: fn(f64) -> f64) -> Term {
    Term::Muscle(Box::new(RunIn {
        share: values[0],
        distance: values[1],
        pace,
    }))
}

/// The state is what is left of the effect, from 1 at first to 0.
struct RunIn {
    share: f64,
    distance: f64,
    /// How quickly that falls relative to itself, of what is left.
    pace: fn(f64) -> f64,
}

impl Dynamics<MusclePoint> for RunIn {
    fn states(&self) -> usize {
        1
    }

    fn settle(&self, _: &MusclePoint, state: &mut [f64]) {
        state[0] = 1.0;
    }

    fn rates(&self, at: &MusclePoint, state: &[f64], rates: &mut [f64]) {
        let way_per_s = at.contraction_rate_per_s * at.direction;
        rates[0] = -way_per_s / self.distance * state[0] * (self.pace)(state[0]);
    }
}

impl MuscleTerm for RunIn {
    fn force_n(&self, _: &MusclePoint, _: &Muscle<f64>, state: &[f64], force_n: f64) -> f64 {
        force_n * (1.0 + self.share * state[0])
    }
}
