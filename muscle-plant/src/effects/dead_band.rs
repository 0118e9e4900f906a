//! `dead-band`: the bladder presses on the braid only above a threshold pressure.

use super::{CompensationMethod, DISCREPANCY_RATIO, EffectKind, Equation, Form, Parameter};
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
    requires: &[],
    signature: "The force at low pressure is too small; above a threshold the loss is constant in \
                pressure.",
    test_signal: "a slow ramp from zero pressure at four contractions; the threshold is the same \
                  at each.",
    discrepancy_ratio: DISCREPANCY_RATIO,
    compensation: CompensationMethod::Unavailable(
        "it changes the static force law, and the controller corrects Eq 1 only for losses",
    ),
    forms: &[
        Form {
            name: "sharp",
            parameters: &[PRESSURE_PA],
            source: "The pressure less a threshold acts on the braid, none below it; Tondu 2012. \
                     Leaves out a rounded onset.",
            build: |values| dead_band(values[0], f64::min),
            observation: None,
        },
        Form {
            name: "rounded",
            parameters: &[PRESSURE_PA],
            source: "The lost pressure approaches the threshold exponentially, as the bladder \
                     comes into contact with the braid gradually. Leaves out a threshold that \
                     changes with contraction.",
            build: |values| {
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
            source: "Parts of the bladder come into contact with the braid at pressures with a \
                     logistic distribution, narrower with larger sharpness; above all of them \
                     their mean is lost. Leaves out a threshold that changes with contraction.",
            build: |values| {
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
