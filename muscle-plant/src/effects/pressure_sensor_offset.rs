//! `pressure-sensor-offset`: the pressure sensor's zero is off.

use super::{EffectKind, Form, Parameter};
use crate::subsystem::Term;
use crate::subsystem::sensors::{Reading, SensorPoint, SensorTerm};
use crate::subsystem::term::Dynamics;

pub(super) const KIND: EffectKind = EffectKind {
    name: "pressure-sensor-offset",
    place: "sensor",
    signature: "The reading disagrees with force and contraction, which stay with the true pressure, \
           by the same amount everywhere.",
    test_signal: "a vented zero, and one known pressure from a gauge.",
    forms: &[Form {
        name: "constant",
        parameters: &[Parameter::new("offset_pa", "Pa", (-1e5, 1e5), 5e3).neutral(0.0)],
        source: "Reading = truth + offset. Leaves out gain and drift, which have their own names.",
        build: |values| {
            Term::Sensor(Box::new(PressureSensorOffset {
                offset_pa: values[0],
            }))
        },
    }],
};

struct PressureSensorOffset {
    offset_pa: f64,
}

impl Dynamics<SensorPoint> for PressureSensorOffset {}

impl SensorTerm for PressureSensorOffset {
    fn read(&self, _: &SensorPoint, _: &[f64], reading: &mut Reading) {
        reading.pressure.0 += self.offset_pa;
    }
}
