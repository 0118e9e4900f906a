//! `bladder-elasticity`: the bladder has to be stretched, the more the muscle contracts.

use super::{EffectKind, Form, Parameter, REFERENCE_CONTRACTION};
use crate::subsystem::Term;
use crate::subsystem::muscle::{MusclePoint, MuscleTerm};
use crate::subsystem::term::Dynamics;
use model_core::muscle::Muscle;

pub(super) const KIND: EffectKind = EffectKind {
    name: "bladder-elasticity",
    place: "muscle-force",
    signature: "The pressure at which the muscle begins to pull rises with contraction: the residual \
           goes with contraction, not with direction, pressure or time.",
    test_signal: "a slow ramp of pressure held at four contractions; the offset of force grows with \
                 contraction.",
    forms: &[
        Form {
            name: "exponential",
            parameters: &[
                Parameter::new("force_n", "N", (-1e3, 1e4), 60.0).neutral(0.0),
                Parameter::new("growth", "1", (0.1, 100.0), 10.0).log(),
            ],
            source: "A force (exp(kε) − 1), its size at a contraction of 0.25, after the strain \
                     stiffening of rubber; Tondu 2012. Leaves out a share that goes with pressure.",
            build: |values| {
                Term::Muscle(Box::new(Exponential {
                    per_exponential_n: values[0] / (values[1] * REFERENCE_CONTRACTION).exp_m1(),
                    growth: values[1],
                }))
            },
        },
        Form {
            name: "polynomial",
            parameters: &[
                Parameter::new("linear_n", "N", (-1e4, 1e4), 30.0).neutral(0.0),
                Parameter::new("quadratic_n", "N", (-1e4, 1e4), 30.0).neutral(0.0),
            ],
            source: "A force linear and quadratic in contraction, their sizes at 0.25: the first \
                     terms of the bladder's strain energy (Chou & Hannaford 1996; Klute & \
                     Hannaford 2000). Leaves out higher terms.",
            build: |values| {
                Term::Muscle(Box::new(Polynomial {
                    linear_n: values[0],
                    quadratic_n: values[1],
                }))
            },
        },
    ],
};

struct Exponential {
    per_exponential_n: f64,
    growth: f64,
}

impl Dynamics<MusclePoint> for Exponential {}

impl MuscleTerm for Exponential {
    fn force_n(&self, at: &MusclePoint, _: &Muscle<f64>, _: &[f64], force_n: f64) -> f64 {
        force_n - self.per_exponential_n * (self.growth * at.contraction).exp_m1()
    }
}

struct Polynomial {
    linear_n: f64,
    quadratic_n: f64,
}

impl Dynamics<MusclePoint> for Polynomial {}

impl MuscleTerm for Polynomial {
    fn force_n(&self, at: &MusclePoint, _: &Muscle<f64>, _: &[f64], force_n: f64) -> f64 {
        let relative = at.contraction / REFERENCE_CONTRACTION;
        force_n - (self.linear_n + self.quadratic_n * relative) * relative
    }
}
