//! `dead-band`: the bladder bears on the braid only above a threshold pressure.

use super::{EffectKind, Form, Parameter};
use crate::subsystem::Term;
use crate::subsystem::muscle::{MusclePoint, MuscleTerm};
use crate::subsystem::term::Dynamics;
use model_core::muscle::Muscle;

const PRESSURE_PA: Parameter = Parameter::new("pressure_pa", "Pa", (0.0, 2e5), 2e4).neutral(0.0);

pub(super) const KIND: EffectKind = EffectKind {
    name: "dead-band",
    place: "muscle-force",
    signature: "The force at low pressure is too small; above a threshold the loss is constant in \
           pressure.",
    test_signal: "a slow ramp from zero pressure at four contractions; the threshold is the same at \
                 each.",
    forms: &[
        Form {
            name: "sharp",
            parameters: &[PRESSURE_PA],
            source: "The pressure less a threshold bears on the braid, none below it; Tondu 2012. \
                     Leaves out a rounded onset.",
            build: |values| dead_band(values[0], f64::min),
        },
        Form {
            name: "rounded",
            parameters: &[PRESSURE_PA],
            source: "The lost pressure approaches the threshold exponentially, as the bladder \
                     comes to lie on the braid bit by bit. Leaves out a threshold that changes \
                     with contraction.",
            build: |values| {
                dead_band(values[0], |pressure_pa, dead_pa| {
                    -dead_pa * (-pressure_pa / dead_pa).exp_m1()
                })
            },
        },
        Form {
            name: "spread",
            parameters: &[
                PRESSURE_PA,
                Parameter::new("sharpness", "1", (0.1, 100.0), 3.0).log(),
            ],
            source: "Parts of the bladder come to lie on the braid at pressures that spread \
                     logistically, the sharper the narrower: their mean is lost above all of them. \
                     Leaves out a threshold that changes with contraction.",
            build: |values| {
                let sharpness = values[1];
                dead_band(values[0], move |pressure_pa, dead_pa| {
                    spread_lost_pa(pressure_pa, dead_pa, sharpness)
                })
            },
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

/// The mean of what a pressure ≥ 0 and thresholds leave, the smaller of the two, where thresholds
/// have a logistic distribution, cut at 0, with the mean `dead_pa`: its centre is `sharpness` times
/// its scale.
fn spread_lost_pa(pressure_pa: f64, dead_pa: f64, sharpness: f64) -> f64 {
    let scale_pa = dead_pa / ((1.0 + (-sharpness).exp()) * softplus(sharpness));
    let below = softplus(pressure_pa / scale_pa - sharpness) - softplus(-sharpness);
    (1.0 + (-sharpness).exp()) * (pressure_pa - scale_pa * below)
}

struct DeadBand<F> {
    pressure_pa: f64,
    /// Lost pressure of a pressure ≥ 0 and a threshold > 0 \[Pa\].
    lost_pa: F,
}

impl<F: Send + Sync> Dynamics<MusclePoint> for DeadBand<F> {}

impl<F: Fn(f64, f64) -> f64 + Send + Sync> MuscleTerm for DeadBand<F> {
    fn force_n(&self, at: &MusclePoint, law: &Muscle<f64>, _: &[f64], force_n: f64) -> f64 {
        if self.pressure_pa == 0.0 {
            return force_n;
        }
        let lost_pa = (self.lost_pa)(at.pressure.0.max(0.0), self.pressure_pa);
        force_n - law.force_per_pressure_m2(at.contraction) * lost_pa
    }
}
