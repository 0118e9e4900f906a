//! `payload`: a mass beside the nominal one.

use super::{
    CompensationMethod, DISCREPANCY_RATIO, EffectKind, Equation, Form, Parameter, Quantity,
    Requirement,
};
use crate::nominal::Weight;
use crate::subsystem::load::{LoadPoint, LoadTerm};
use crate::subsystem::term::Dynamics;
use crate::subsystem::{Subsystem, Term};

/// The kind, for the catalogue.
pub static KIND: EffectKind = EffectKind {
    name: "payload",
    subsystem: Subsystem::Load,
    equations: &[Equation::Load],
    requires: &[Requirement::Motion],
    signature: "Weight and inertia change together: the equilibrium and the natural frequency.",
    test_signal: "the same triangles with a known weight added; equilibrium and natural frequency \
                  change together.",
    discrepancy_ratio: DISCREPANCY_RATIO,
    law_quantities: &[Quantity::Contraction],
    compensation: CompensationMethod::Payload(|effect| effect.value("mass_kg").unwrap_or(0.0)),
    forms: &[Form {
        name: "mass",
        parameters: &[Parameter::new("mass_kg", "kg", (-1e3, 1e3), 1.0).neutral(0.0)],
        equation: "Eq 5 with M = load.mass_kg + mass_kg",
        source: "Eq 5 with another mass.",
        leaves_out: "a payload that swings",
        build: &|values| Term::Load(Box::new(Payload { mass_kg: values[0] })),
        observation: None,
    }],
};

/// Smallest total mass \[kg\]: with none Eq 5 has no solution.
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

#[cfg(test)]
mod tests {
    use super::super::testing::{effect, run, steps};
    use super::KIND;
    use crate::nominal::{Load, Nominal, Weight};

    #[test]
    fn a_payload_is_a_larger_mass() {
        let nominal = Nominal::REFERENCE;
        let Load::Weight(weight) = nominal.load else {
            panic!("the reference rig has a weight");
        };
        let heavier = Nominal {
            load: Load::Weight(Weight {
                mass_kg: weight.mass_kg + 2.0,
                ..weight
            }),
            ..nominal
        };
        let payload = effect(&KIND, "mass", &[("mass_kg", 2.0)]);
        let loaded = run(&nominal, &[payload], &steps(4.0));
        let expected = run(&heavier, &[], &steps(4.0));
        assert_eq!(loaded.pressure_pa, expected.pressure_pa);
        assert_eq!(loaded.contraction, expected.contraction);
        assert_eq!(loaded.force_n, expected.force_n);
        assert_ne!(
            loaded.contraction,
            run(&nominal, &[], &steps(4.0)).contraction
        );
    }
}
