//! `dead-band`: the bladder bears on the braid only above a threshold pressure.

use super::{EffectKind, Form, Parameter};
use crate::plant::Term;
use crate::plant::muscle::{MusclePoint, MuscleTerm};
use crate::plant::term::Dynamics;
use model_core::muscle::Muscle;

const PRESSURE_PA: Parameter = Parameter::new("pressure_pa", "Pa", (0.0, 2e5), 2e4).neutral(0.0);

pub(super) const KIND: EffectKind = EffectKind {
    name: "dead-band",
    block: "muscle-force",
    mark: "The force at low pressure is too small; above a threshold the loss is constant in \
           pressure.",
    experiment: "a slow ramp from zero pressure at four contractions; the threshold is the same at \
                 each.",
    forms: &[
        Form {
            name: "sharp",
            parameters: &[PRESSURE_PA],
            source: "The pressure less a threshold bears on the braid, none below it; Tondu 2012. \
                     Leaves out a rounded onset.",
            build: |values| dead_band(values[0], |pressure_pa, dead_pa| pressure_pa.min(dead_pa)),
        },
        Form {
            name: "rounded",
            parameters: &[PRESSURE_PA],
            source: "The lost pressure approaches the threshold exponentially, as the bladder \
                     comes to lie on the braid bit by bit. Leaves out a threshold that changes \
                     with contraction.",
            build: |values| {
                dead_band(values[0], |pressure_pa, dead_pa| match dead_pa {
                    0.0 => 0.0,
                    _ => -dead_pa * (-pressure_pa / dead_pa).exp_m1(),
                })
            },
        },
    ],
};

fn dead_band(pressure_pa: f64, lost_pa: fn(f64, f64) -> f64) -> Term {
    Term::Muscle(Box::new(DeadBand {
        pressure_pa,
        lost_pa,
    }))
}

struct DeadBand {
    pressure_pa: f64,
    /// Lost pressure of a pressure ≥ 0 and the threshold \[Pa\].
    lost_pa: fn(f64, f64) -> f64,
}

impl Dynamics<MusclePoint> for DeadBand {}

impl MuscleTerm for DeadBand {
    fn force_n(&self, at: &MusclePoint, law: &Muscle<f64>, _: &[f64], force_n: f64) -> f64 {
        let lost_pa = (self.lost_pa)(at.pressure.0.max(0.0), self.pressure_pa);
        force_n - law.force_per_pressure_m2(at.contraction) * lost_pa
    }
}
