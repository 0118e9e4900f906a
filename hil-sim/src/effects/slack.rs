//! `slack`: a muscle cannot push.

use super::{EffectKind, Form, Parameter};
use crate::plant::Term;
use crate::plant::muscle::{MusclePoint, MuscleTerm};
use crate::plant::term::Dynamics;
use model_core::muscle::Muscle;

pub(super) const KIND: EffectKind = EffectKind {
    name: "slack",
    block: "muscle-force",
    mark: "The force is flat at zero below a threshold pressure, where Eq 1 has the muscle push.",
    experiment: "a slow ramp from a vented muscle with the force channel; the force is flat at \
                 zero \
                 below a threshold.",
    forms: &[
        Form {
            name: "sharp",
            parameters: &[],
            source: "The muscle hangs loose where Eq 1 with all other effects is below zero. \
                     Leaves out the fold's own stiffness.",
            build: |_| Term::Muscle(Box::new(Slack { rounding_n: 0.0 })),
        },
        Form {
            name: "rounded",
            parameters: &[Parameter::new("rounding_n", "N", (0.0, 1e3), 10.0)],
            source: "A hyperbola about the corner: at zero half its rounding is left. Leaves out a \
                     force that is zero indeed.",
            build: |values| {
                Term::Muscle(Box::new(Slack {
                    rounding_n: values[0],
                }))
            },
        },
    ],
};

struct Slack {
    rounding_n: f64,
}

impl Dynamics<MusclePoint> for Slack {}

impl MuscleTerm for Slack {
    fn force_n(&self, _: &MusclePoint, _: &Muscle<f64>, _: &[f64], force_n: f64) -> f64 {
        force_n
    }

    fn limit_n(&self, force_n: f64) -> f64 {
        if self.rounding_n == 0.0 {
            return force_n.max(0.0);
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
