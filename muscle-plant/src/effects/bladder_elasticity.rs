//! `bladder-elasticity`: the stretched bladder takes a force that grows with contraction.

use super::{
    CompensationMethod, DISCREPANCY_RATIO, EffectKind, Equation, Form, Parameter, Quantity,
    REFERENCE_CONTRACTION,
};
use crate::subsystem::muscle::{MusclePoint, MuscleTerm};
use crate::subsystem::term::Dynamics;
use crate::subsystem::{Subsystem, Term};
use model_core::muscle::Muscle;

/// The kind, for the catalogue.
pub static KIND: EffectKind = EffectKind {
    name: "bladder-elasticity",
    subsystem: Subsystem::MuscleForce,
    equations: &[Equation::MuscleForce],
    requires: &[],
    signature: "The pressure at which the muscle begins to pull rises with contraction: the \
                residual depends on contraction, not on direction, pressure or time.",
    test_signal: "a slow ramp of pressure held at four contractions; the offset of force grows \
                  with contraction.",
    discrepancy_ratio: DISCREPANCY_RATIO,
    law_quantities: &[Quantity::Pressure, Quantity::Contraction],
    compensation: CompensationMethod::Unavailable(
        "it changes the static force law, and the controller corrects Eq 1 only for losses",
    ),
    forms: &[
        Form {
            name: "exponential",
            parameters: &[
                Parameter::new("force_n", "N", (-1e3, 1e4), 60.0).neutral(0.0),
                Parameter::new("growth", "1", (0.1, 100.0), 10.0).log(),
            ],
            equation: "F = Eq 1 − force_n · (exp(growth · ε) − 1)/(exp(growth · 0.25) − 1)",
            source: "A force proportional to exp(kε) − 1, with its size at a contraction of 0.25, \
                     after the strain stiffening of rubber; Tondu 2012.",
            leaves_out: "a share that depends on pressure",
            build: &|values| {
                Term::Muscle(Box::new(Exponential {
                    per_exponential_n: values[0] / (values[1] * REFERENCE_CONTRACTION).exp_m1(),
                    growth: values[1],
                }))
            },
            observation: None,
        },
        Form {
            name: "polynomial",
            parameters: &[
                Parameter::new("linear_n", "N", (-1e4, 1e4), 30.0).neutral(0.0),
                Parameter::new("quadratic_n", "N", (-1e4, 1e4), 30.0).neutral(0.0),
            ],
            equation: "F = Eq 1 − linear_n · e − quadratic_n · e², e = ε/0.25",
            source: "A force linear and quadratic in contraction, with sizes at 0.25: the first \
                     terms of the bladder's strain energy (Chou & Hannaford 1996; Klute & \
                     Hannaford 2000).",
            leaves_out: "higher terms",
            build: &|values| {
                Term::Muscle(Box::new(Polynomial {
                    linear_n: values[0],
                    quadratic_n: values[1],
                }))
            },
            observation: None,
        },
    ],
};

struct Exponential {
    per_exponential_n: f64,
    growth: f64,
}

impl Dynamics<MusclePoint> for Exponential {}

impl MuscleTerm for Exponential {
    fn force_n(&self, point: &MusclePoint, _: &Muscle<f64>, _: &[f64], force_n: f64) -> f64 {
        force_n - self.per_exponential_n * (self.growth * point.contraction).exp_m1()
    }
}

struct Polynomial {
    linear_n: f64,
    quadratic_n: f64,
}

impl Dynamics<MusclePoint> for Polynomial {}

impl MuscleTerm for Polynomial {
    fn force_n(&self, point: &MusclePoint, _: &Muscle<f64>, _: &[f64], force_n: f64) -> f64 {
        let relative = point.contraction / REFERENCE_CONTRACTION;
        force_n - (self.linear_n + self.quadratic_n * relative) * relative
    }
}

#[cfg(test)]
mod tests {
    use super::super::testing::{STEP_S, added_n, assert_near, bench, effect, through};
    use super::KIND;

    fn assert_force(form: &str, values: &[(&str, f64)], expected_n: impl Fn(f64) -> f64) {
        let ramp = bench(STEP_S, 101, through([(0.0, 0.0), (1.0, 0.25)]), |t| 2e5 * t);
        let added = added_n(&effect(&KIND, form, values), &ramp);
        for (row, added) in added.iter().enumerate() {
            let contraction = 0.25 * row as f64 * STEP_S;
            assert_near(*added, expected_n(contraction), 1e-8, form);
        }
    }

    #[test]
    fn the_force_is_its_formula_at_every_contraction_and_pressure() {
        let parameters = [("force_n", 60.0), ("growth", 12.0)];
        assert_force("exponential", &parameters, |contraction| {
            -60.0 * ((12.0 * contraction).exp() - 1.0) / (3.0_f64.exp() - 1.0)
        });
        let parameters = [("linear_n", 30.0), ("quadratic_n", -80.0)];
        assert_force("polynomial", &parameters, |contraction| {
            -30.0 * (contraction / 0.25) + 80.0 * (contraction / 0.25).powi(2)
        });
    }
}
