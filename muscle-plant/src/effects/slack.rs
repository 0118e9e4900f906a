//! `slack`: the muscle cannot push, so that its force is limited from below.

use super::{
    CompensationMethod, DISCREPANCY_RATIO, EffectKind, Equation, Form, Parameter, Quantity,
    Requirement,
};
use crate::subsystem::muscle::{MusclePoint, MuscleTerm};
use crate::subsystem::term::Dynamics;
use crate::subsystem::{Subsystem, Term};
use model_core::muscle::Muscle;

/// The kind, for the catalogue.
pub static KIND: EffectKind = EffectKind {
    name: "slack",
    subsystem: Subsystem::MuscleForce,
    equations: &[Equation::MuscleForce],
    requires: &[Requirement::Vented],
    signature: "The force is flat at zero below a threshold pressure, where Eq 1 has the muscle \
                push.",
    test_signal: "a slow ramp from a vented muscle with the force channel; the force is flat at \
                  zero below a threshold.",
    discrepancy_ratio: DISCREPANCY_RATIO,
    law_quantities: &[Quantity::Pressure, Quantity::Contraction],
    compensation: CompensationMethod::Unavailable(
        "it changes the static force law, and the controller corrects Eq 1 only for losses",
    ),
    forms: &[
        Form {
            name: "sharp",
            parameters: &[],
            equation: "F = max(F′, 0), F′ the force of Eq 1 with all other effects",
            source: "No force where Eq 1 with all other effects is below zero.",
            leaves_out: "the stiffness of a folded muscle",
            build: &|_| slack(0.0, 0.0),
            observation: None,
        },
        Form {
            name: "rounded",
            parameters: &[Parameter::new("rounding_n", "N", (0.0, 1e3), 10.0)],
            equation: "F = (F′ + √(F′² + rounding_n²))/2, F′ the force of Eq 1 with all other \
                       effects",
            source: "A hyperbola about the corner: where Eq 1 is zero, half the rounding is left.",
            leaves_out: "a force that is exactly zero",
            build: &|values| slack(values[0], 0.0),
            observation: None,
        },
        Form {
            name: "folded",
            parameters: &[Parameter::new("push_share", "1", (0.0, 1.0), 0.1)],
            equation: "F = max(F′, push_share · F′), F′ the force of Eq 1 with all other effects",
            source: "Below zero a share of Eq 1 remains, as a folded hose still resists bending.",
            leaves_out: "that a fold forms suddenly (Euler buckling)",
            build: &|values| slack(0.0, values[0]),
            observation: None,
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
        // Below zero the sum would lose its digits by cancellation.
        if force_n > 0.0 {
            0.5 * (force_n + root_n)
        } else {
            0.5 * self.rounding_n * self.rounding_n / (root_n - force_n)
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::bladder_elasticity;
    use super::super::testing::{CLAMPED, STEP_S, assert_near, bench, effect, force_n, through};
    use super::KIND;
    use model_core::pressure::GaugePa;

    /// Compares the force on a ramp of contraction and pressure with a function of Eq 1.
    fn assert_limited(form: &str, values: &[(&str, f64)], limited_n: impl Fn(f64) -> f64) {
        let ramp = bench(STEP_S, 101, through([(0.0, 0.0), (1.0, 0.25)]), |t| 2e5 * t);
        let found_n = force_n(&[effect(&KIND, form, values)], &ramp);
        for (row, found_n) in found_n.iter().enumerate() {
            let share = row as f64 * STEP_S;
            let law_n = CLAMPED.muscle.force_n(0.25 * share, GaugePa(2e5 * share));
            assert_near(*found_n, limited_n(law_n), 1e-8, form);
        }
    }

    #[test]
    fn the_force_is_limited_below_as_its_form_says() {
        assert_limited("sharp", &[], |law_n| law_n.max(0.0));
        assert_limited("rounded", &[("rounding_n", 10.0)], |law_n| {
            0.5 * (law_n + law_n.hypot(10.0))
        });
        assert_limited("folded", &[("push_share", 0.2)], |law_n| {
            law_n.max(0.2 * law_n)
        });
    }

    #[test]
    fn slack_limits_the_force_with_effects_that_are_added_after_it() {
        let parameters = [("linear_n", 300.0), ("quadratic_n", 0.0)];
        let elastic = effect(&bladder_elasticity::KIND, "polynomial", &parameters);
        let ramp = bench(STEP_S, 101, through([(0.0, 0.0), (1.0, 0.2)]), |_| 1e5);
        let found_n = force_n(&[effect(&KIND, "sharp", &[]), elastic], &ramp);
        assert!(found_n.iter().all(|force_n| *force_n >= 0.0) && found_n[100] == 0.0);
    }
}
