//! `dead-band`: the bladder bears on the braid only above a threshold pressure.

use super::{EffectKind, Parameter};
use crate::plant::Term;
use crate::plant::muscle::{MusclePoint, MuscleTerm};
use crate::plant::term::Dynamics;
use model_core::muscle::Muscle;

pub(super) const KIND: EffectKind = EffectKind {
    name: "dead-band",
    block: "muscle-force",
    parameters: &[Parameter {
        name: "pressure_pa",
        unit: "Pa",
        min: 0.0,
        max: 2e5,
    }],
    mark: "The force at low pressure is too small; above a threshold the loss is constant.",
    source: "Tondu 2012, review of McKibben muscle models. Leaves out a rounded onset.",
    build: |values| {
        Term::Muscle(Box::new(DeadBand {
            pressure_pa: values[0],
        }))
    },
};

struct DeadBand {
    pressure_pa: f64,
}

impl Dynamics<MusclePoint> for DeadBand {}

impl MuscleTerm for DeadBand {
    fn force_n(&self, at: &MusclePoint, law: &Muscle<f64>, _: &[f64], force_n: f64) -> f64 {
        let lost_pa = at.pressure.0.clamp(0.0, self.pressure_pa);
        force_n - law.force_per_pressure_m2(at.contraction) * lost_pa
    }
}
