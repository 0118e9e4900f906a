//! `pressure-sensor-gain`: the pressure sensor's span is off.

use super::{EffectKind, Form, Parameter, REFERENCE_PRESSURE_PA};
use crate::subsystem::Term;
use crate::subsystem::sensors::{Reading, SensorPoint, SensorTerm};
use crate::subsystem::term::Dynamics;

pub(super) const KIND: EffectKind = EffectKind {
    name: "pressure-sensor-gain",
    place: "sensor",
    signature: "The reading disagrees with force and contraction, which stay with the true pressure, \
           in proportion to the pressure.",
    test_signal: "two known pressures from a gauge, far apart.",
    forms: &[
        Form {
            name: "proportional",
            parameters: &[GAIN_ERROR],
            source: "Reading = truth · (1 + error). Leaves out a characteristic that is not \
                     straight.",
            build: |values| {
                Term::Sensor(Box::new(PressureSensorGain {
                    gain_error: values[0],
                    nonlinearity: 0.0,
                }))
            },
        },
        Form {
            name: "quadratic",
            parameters: &[
                GAIN_ERROR,
                Parameter::new("nonlinearity", "1", (-0.1, 0.1), 0.005).neutral(0.0),
            ],
            source: "Reading = truth · (1 + error + nonlinearity · truth / 300 kPa): as data \
                     sheets of pressure sensors tell both. Leaves out what the sensor remembers.",
            build: |values| {
                Term::Sensor(Box::new(PressureSensorGain {
                    gain_error: values[0],
                    nonlinearity: values[1],
                }))
            },
        },
    ],
};

const GAIN_ERROR: Parameter = Parameter::new("gain_error", "1", (-0.4, 0.4), 0.02).neutral(0.0);

struct PressureSensorGain {
    gain_error: f64,
    nonlinearity: f64,
}

impl Dynamics<SensorPoint> for PressureSensorGain {}

impl SensorTerm for PressureSensorGain {
    fn read(&self, at: &SensorPoint, _: &[f64], reading: &mut Reading) {
        let truth_pa = at.truth.pressure.0;
        let error = self.gain_error + self.nonlinearity * truth_pa / REFERENCE_PRESSURE_PA;
        reading.pressure.0 += truth_pa * error;
    }
}
