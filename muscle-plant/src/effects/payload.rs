//! `payload`: the mass is not the nominal one.

use super::{EffectKind, Form, Parameter};
use crate::subsystem::Term;
use crate::subsystem::load::{LoadPoint, LoadTerm};
use crate::subsystem::term::Dynamics;
use crate::nominal::Weight;

pub(super) const KIND: EffectKind = EffectKind {
    name: "payload",
    place: "load",
    signature: "Weight and inertia change together: the equilibrium and the natural frequency.",
    test_signal: "the same triangles with a known weight added; equilibrium and natural frequency \
                 move \
                 together.",
    forms: &[Form {
        name: "mass",
        parameters: &[Parameter::new("mass_kg", "kg", (-1e3, 1e3), 1.0).neutral(0.0)],
        source: "Eq 5 with another mass. Leaves out a payload that swings.",
        build: |values| Term::Load(Box::new(Payload { mass_kg: values[0] })),
    }],
};

/// The smallest mass that a payload may leave \[kg\], so that Eq 5 stays solvable.
const MASS_KG_MIN: f64 = 1e-3;

struct Payload {
    mass_kg: f64,
}

impl Dynamics<LoadPoint> for Payload {}

impl LoadTerm for Payload {
    fn change(&self, _: &LoadPoint, _: &[f64], weight: &mut Weight, _: &mut f64) {
        weight.mass_kg = (weight.mass_kg + self.mass_kg).max(MASS_KG_MIN);
    }
}
