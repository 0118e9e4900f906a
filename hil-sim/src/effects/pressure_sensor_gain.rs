//! `pressure-sensor-gain`: the pressure sensor's span is off.

use super::{EffectKind, Form, Parameter};
use crate::plant::Term;
use crate::plant::sensors::{Reading, SensorPoint, SensorTerm};
use crate::plant::term::Dynamics;

pub(super) const KIND: EffectKind = EffectKind {
    name: "pressure-sensor-gain",
    block: "sensor",
    mark: "The reading disagrees with force and contraction, which stay with the true pressure, \
           in proportion to the pressure.",
    experiment: "two known pressures from a gauge, far apart.",
    forms: &[Form {
        name: "proportional",
        parameters: &[Parameter::new("gain_error", "1", (-0.4, 0.4), 0.02).neutral(0.0)],
        source: "Reading = truth · (1 + error). Leaves out a characteristic that is not straight.",
        build: |values| {
            Term::Sensor(Box::new(PressureSensorGain {
                gain_error: values[0],
            }))
        },
    }],
};

struct PressureSensorGain {
    gain_error: f64,
}

impl Dynamics<SensorPoint> for PressureSensorGain {}

impl SensorTerm for PressureSensorGain {
    fn read(&self, at: &SensorPoint, _: &[f64], reading: &mut Reading) {
        reading.pressure.0 += self.gain_error * at.truth.pressure.0;
    }
}
