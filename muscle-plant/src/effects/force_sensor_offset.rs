//! `force-sensor-offset`: the force sensor's zero is off.

use super::{CompensationMethod, EffectKind, Equation, Form, Parameter, Requirement};
use crate::subsystem::sensors::{Reading, SensorPoint, SensorTerm};
use crate::subsystem::term::Dynamics;
use crate::subsystem::{Subsystem, Term};

/// The kind, for the catalogue.
pub static KIND: EffectKind = EffectKind {
    name: "force-sensor-offset",
    subsystem: Subsystem::Sensor,
    equations: &[Equation::MuscleForce, Equation::Load],
    requires: &[Requirement::MeasuredForce],
    signature: "The reading is off by the same amount everywhere, also where the muscle is slack.",
    test_signal: "the force of the unmounted sensor, and of the vented muscle at each length.",
    discrepancy_ratio: 0.0,
    compensation: CompensationMethod::Unavailable("the controller does not use the force sensor"),
    forms: &[Form {
        name: "constant",
        parameters: &[Parameter::new("offset_n", "N", (-1e3, 1e3), 10.0).neutral(0.0)],
        source: "Reading = truth + offset: the load cell's zero balance, mounting and tare (ISO \
                 376). Leaves out gain and drift.",
        build: |values| {
            Term::Sensor(Box::new(ForceSensorOffset {
                offset_n: values[0],
            }))
        },
        observation: None,
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
