//! `force-sensor-offset`: the force sensor's zero is off.

use super::{EffectKind, Form, Parameter};
use crate::subsystem::Term;
use crate::subsystem::sensors::{Reading, SensorPoint, SensorTerm};
use crate::subsystem::term::Dynamics;

pub(super) const KIND: EffectKind = EffectKind {
    name: "force-sensor-offset",
    place: "sensor",
    signature: "The reading is off by the same amount everywhere, also where the muscle hangs loose.",
    test_signal: "the force of the unmounted sensor, and of the vented muscle at each length.",
    forms: &[Form {
        name: "constant",
        parameters: &[Parameter::new("offset_n", "N", (-1e3, 1e3), 10.0).neutral(0.0)],
        source: "Reading = truth + offset: the load cell's zero balance, mounting and tare \
                 (ISO 376). Leaves out gain and drift.",
        build: |values| {
            Term::Sensor(Box::new(ForceSensorOffset {
                offset_n: values[0],
            }))
        },
    }],
};

struct ForceSensorOffset {
    offset_n: f64,
}

impl Dynamics<SensorPoint> for ForceSensorOffset {}

impl SensorTerm for ForceSensorOffset {
    fn read(&self, _: &SensorPoint, _: &[f64], reading: &mut Reading) {
        reading.force_n += self.offset_n;
    }
}
