//! `contraction-sensor-offset`: the encoder lost its homing.

use super::{EffectKind, Form, Parameter};
use crate::subsystem::Term;
use crate::subsystem::sensors::{Reading, SensorPoint, SensorTerm};
use crate::subsystem::term::Dynamics;

pub(super) const KIND: EffectKind = EffectKind {
    name: "contraction-sensor-offset",
    place: "sensor",
    signature: "The force law holds at a shifted contraction; the dynamics are untouched.",
    test_signal: "the muscle vented and hung free: the encoder must read zero.",
    forms: &[Form {
        name: "constant",
        parameters: &[Parameter::new("offset", "1", (-0.2, 0.2), 0.01).neutral(0.0)],
        source: "Reading = truth + offset, in contraction. Leaves out lost counts while it moves.",
        build: |values| Term::Sensor(Box::new(ContractionSensorOffset { offset: values[0] })),
    }],
};

struct ContractionSensorOffset {
    offset: f64,
}

impl Dynamics<SensorPoint> for ContractionSensorOffset {}

impl SensorTerm for ContractionSensorOffset {
    fn read(&self, _: &SensorPoint, _: &[f64], reading: &mut Reading) {
        reading.contraction += self.offset;
    }
}
