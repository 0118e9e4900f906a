//! `dead-band`: the bladder presses on the braid only above a threshold pressure.

use super::{
    CompensationMethod, DISCREPANCY_RATIO, EffectKind, Equation, Form, Parameter, Quantity,
    Requirement,
};
use crate::subsystem::muscle::{MusclePoint, MuscleTerm};
use crate::subsystem::term::Dynamics;
use crate::subsystem::{Subsystem, Term};
use model_core::muscle::Muscle;

const PRESSURE_PA: Parameter = Parameter::new("pressure_pa", "Pa", (0.0, 2e5), 2e4).neutral(0.0);

/// The kind, for the catalogue.
pub static KIND: EffectKind = EffectKind {
    name: "dead-band",
    subsystem: Subsystem::MuscleForce,
    equations: &[Equation::MuscleForce],
    requires: &[Requirement::Vented],
    signature: "The force at low pressure is too small; above a threshold the loss is constant in \
                pressure.",
    test_signal: "a slow ramp from zero pressure at four contractions; the threshold is the same \
                  at each.",
    discrepancy_ratio: DISCREPANCY_RATIO,
    law_quantities: &[Quantity::Pressure, Quantity::Contraction],
    compensation: CompensationMethod::Unavailable(
        "it changes the static force law, and the controller corrects Eq 1 only for losses",
    ),
    forms: &[
        Form {
            name: "sharp",
            parameters: &[PRESSURE_PA],
            equation: "F = Eq 1 − f_p · min(P, pressure_pa), f_p = ∂F/∂P",
            source: "The pressure less a threshold acts on the braid, none below it; Tondu 2012.",
            leaves_out: "a rounded onset",
            build: &|values| dead_band(values[0], f64::min),
            observation: None,
        },
        Form {
            name: "rounded",
            parameters: &[PRESSURE_PA],
            equation: "F = Eq 1 − f_p · pressure_pa · (1 − exp(−P/pressure_pa)), f_p = ∂F/∂P",
            source: "The lost pressure approaches the threshold exponentially, as the bladder \
                     comes into contact with the braid gradually.",
            leaves_out: "a threshold that changes with contraction",
            build: &|values| {
                dead_band(values[0], |pressure_pa, dead_pa| {
                    -dead_pa * (-pressure_pa / dead_pa).exp_m1()
                })
            },
            observation: None,
        },
        Form {
            name: "spread",
            parameters: &[
                PRESSURE_PA,
                Parameter::new("sharpness", "1", (0.1, 100.0), 3.0).log(),
            ],
            equation: "F = Eq 1 − f_p · (mean of min(P, T)), f_p = ∂F/∂P; the thresholds T have a \
                       logistic distribution cut at 0 with the mean pressure_pa, whose centre is \
                       sharpness times its scale",
            source: "Parts of the bladder come into contact with the braid at pressures with a \
                     logistic distribution, narrower with larger sharpness; above all of them \
                     their mean is lost.",
            leaves_out: "a threshold that changes with contraction",
            build: &|values| {
                let sharpness = values[1];
                dead_band(values[0], move |pressure_pa, dead_pa| {
                    spread_lost_pa(pressure_pa, dead_pa, sharpness)
                })
            },
            observation: None,
        },
    ],
};

fn dead_band(pressure_pa: f64, lost_pa: impl Fn(f64, f64) -> f64 + Send + Sync + 'static) -> Term {
    Term::Muscle(Box::new(DeadBand {
        pressure_pa,
        lost_pa,
    }))
}

/// ln(1 + eˣ).
fn softplus(x: f64) -> f64 {
    x.max(0.0) + (-x.abs()).exp().ln_1p()
}

/// Mean of min(pressure, threshold) \[Pa\] for a pressure ≥ 0 and thresholds with a logistic
/// distribution cut at 0, with the mean `dead_pa`; its centre is `sharpness` times its scale.
fn spread_lost_pa(pressure_pa: f64, dead_pa: f64, sharpness: f64) -> f64 {
    let scale_pa = dead_pa / ((1.0 + (-sharpness).exp()) * softplus(sharpness));
    let below = softplus(pressure_pa / scale_pa - sharpness) - softplus(-sharpness);
    (1.0 + (-sharpness).exp()) * (pressure_pa - scale_pa * below)
}

struct DeadBand<F> {
    pressure_pa: f64,
    /// Lost pressure for a pressure ≥ 0 and a threshold > 0 \[Pa\].
    lost_pa: F,
}

impl<F: Send + Sync> Dynamics<MusclePoint> for DeadBand<F> {}

impl<F: Fn(f64, f64) -> f64 + Send + Sync> MuscleTerm for DeadBand<F> {
    fn force_n(&self, point: &MusclePoint, law: &Muscle<f64>, _: &[f64], force_n: f64) -> f64 {
        if self.pressure_pa == 0.0 {
            return force_n;
        }
        let lost_pa = (self.lost_pa)(point.pressure.0.max(0.0), self.pressure_pa);
        force_n - law.force_per_pressure_m2(point.contraction) * lost_pa
    }
}

#[cfg(test)]
mod tests {
    use super::super::testing::{
        CLAMPED, STEP_S, added_n, assert_near, bench, driven, effect, force_n, largest_difference,
        pressure_pa, through,
    };
    use super::KIND;
    use model_core::pressure::GaugePa;

    #[test]
    fn a_sharp_dead_band_reduces_the_pressure_by_the_threshold() {
        let dead = || [effect(&KIND, "sharp", &[("pressure_pa", 2e4)])];
        let wave = driven(4.0, |time_s| 2e5 + 5e4 * (3.0 * time_s).sin());
        let found_pa = pressure_pa(&dead(), &wave);
        assert_eq!(found_pa, pressure_pa(&[], &wave));
        let expected_n: Vec<f64> = found_pa
            .iter()
            .map(|pressure_pa| CLAMPED.muscle.force_n(0.1, GaugePa(pressure_pa - 2e4)))
            .collect();
        assert!(largest_difference(&force_n(&dead(), &wave), &expected_n) < 1e-9);
    }

    /// Compares the force on a ramp of contraction and pressure with the lost pressure by formula.
    fn assert_lost(form: &str, values: &[(&str, f64)], lost_pa: impl Fn(f64) -> f64) {
        let ramp = bench(STEP_S, 101, through([(0.0, 0.0), (1.0, 0.25)]), |t| 2e5 * t);
        let added = added_n(&effect(&KIND, form, values), &ramp);
        for (row, added) in added.iter().enumerate() {
            let share = row as f64 * STEP_S;
            let per_pressure_m2 = CLAMPED.muscle.force_per_pressure_m2(0.25 * share);
            assert_near(*added, -per_pressure_m2 * lost_pa(2e5 * share), 1e-8, form);
        }
    }

    #[test]
    fn a_rounded_dead_band_approaches_the_threshold_exponentially() {
        assert_lost("rounded", &[("pressure_pa", 2e4)], |pressure_pa| {
            2e4 * (1.0 - (-pressure_pa / 2e4).exp())
        });
    }

    /// The mean of min(pressure, threshold) is the integral of the share of thresholds above a
    /// pressure.
    #[test]
    fn a_spread_dead_band_is_the_mean_over_its_thresholds() {
        let (dead_pa, sharpness) = (2e4, 2.0_f64);
        let centre_pa =
            sharpness * dead_pa / (1.0 + (-sharpness).exp()) / (1.0 + sharpness.exp()).ln();
        let above = |pressure_pa: f64| {
            let share = |pa: f64| 1.0 / (1.0 + (sharpness * (pa / centre_pa - 1.0)).exp());
            share(pressure_pa) / share(0.0)
        };
        let parameters = [("pressure_pa", dead_pa), ("sharpness", sharpness)];
        assert_lost("spread", &parameters, |pressure_pa| {
            let step_pa = pressure_pa / 1e5;
            let middles = (0..100_000).map(|i| (f64::from(i) + 0.5) * step_pa);
            middles.map(|pa| above(pa) * step_pa).sum::<f64>()
        });
    }
}
