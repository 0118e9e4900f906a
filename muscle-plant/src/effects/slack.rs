//! `slack`: a muscle cannot push.

use super::{EffectKind, Form, Parameter};
use crate::subsystem::Term;
use crate::subsystem::muscle::{MusclePoint, MuscleTerm};
use crate::subsystem::term::Dynamics;
use model_core::muscle::Muscle;

pub(super) const KIND: EffectKind = EffectKind {
    name: "slack",
    place: "muscle-force",
    signature: "The force is flat at zero below a threshold pressure, where Eq 1 has the muscle push.",
    test_signal: "a slow ramp from a vented muscle with the force channel; the force is flat at \
                 zero \
                 below a threshold.",
    forms: &[
        Form {
            name: "sharp",
            parameters: &[],
            source: "The muscle hangs loose where Eq 1 with all other effects is below zero. \
                     Leaves out the fold's own stiffness.",
            build: |_| slack(0.0, 0.0),
        },
        Form {
            name: "rounded",
            parameters: &[Parameter::new("rounding_n", "N", (0.0, 1e3), 10.0)],
            source: "A hyperbola about the corner: at zero half its rounding is left. Leaves out a \
                     force that is zero indeed.",
            build: |values| slack(values[0], 0.0),
        },
        Form {
            name: "folded",
            parameters: &[Parameter::new("push_share", "1", (0.0, 1.0), 0.1)],
            source: "Below zero a share of what Eq 1 would push is left, as a folded hose still \
                     bends. Leaves out that a fold forms at once (Euler).",
            build: |values| slack(0.0, values[0]),
        },
    ],
};

fn slack(rounding_n: f64, push_share: f64) -> Term {
    Term::Muscle(Box::new(Slack {
        rounding_n,
        push_share,
    }))
}

struct Slack {
    rounding_n: f64,
    push_share: f64,
}

impl Dynamics<MusclePoint> for Slack {}

impl MuscleTerm for Slack {
    fn force_n(&self, _: &MusclePoint, _: &Muscle<f64>, _: &[f64], force_n: f64) -> f64 {
        force_n
    }

    fn limit_n(&self, force_n: f64) -> f64 {
        if self.rounding_n == 0.0 {
            return force_n.max(self.push_share * force_n);
        }
        let root_n = force_n.hypot(self.rounding_n);
        // Below zero the sum would cancel.
        if force_n > 0.0 {
            0.5 * (force_n + root_n)
        } else {
            0.5 * self.rounding_n * self.rounding_n / (root_n - force_n)
        }
    }
}
