//! `pressure-sensor-gain`: the pressure sensor's span is off.

use super::{
    CompensationMethod, DISCREPANCY_RATIO, Effect, EffectKind, Equation, Form, Parameter, Quantity,
    REFERENCE_PRESSURE_PA,
};
use crate::subsystem::sensors::{Reading, SensorPoint, SensorTerm};
use crate::subsystem::term::Dynamics;
use crate::subsystem::{Subsystem, Term};

/// The kind, for the catalogue.
pub static KIND: EffectKind = EffectKind {
    name: "pressure-sensor-gain",
    subsystem: Subsystem::Sensor,
    equations: &[Equation::Gas, Equation::MuscleForce],
    requires: &[],
    signature: "The reading differs in proportion to the pressure from the true pressure, with \
                which force and contraction agree.",
    test_signal: "two known pressures from a gauge, far apart.",
    discrepancy_ratio: DISCREPANCY_RATIO,
    law_quantities: &[Quantity::Pressure],
    compensation: CompensationMethod::PressureSensorGain(error_at_reference),
    forms: &[
        Form {
            name: "proportional",
            parameters: &[GAIN_ERROR],
            equation: "Reading = P · (1 + gain_error)",
            source: "Reading = truth · (1 + error).",
            leaves_out: "a nonlinear characteristic",
            build: &|values| {
                Term::Sensor(Box::new(PressureSensorGain {
                    gain_error: values[0],
                    nonlinearity: 0.0,
                }))
            },
            observation: None,
        },
        Form {
            name: "quadratic",
            parameters: &[
                GAIN_ERROR,
                Parameter::new("nonlinearity", "1", (-0.1, 0.1), 0.005).neutral(0.0),
            ],
            equation: "Reading = P · (1 + gain_error + nonlinearity · P/300 kPa)",
            source: "Reading = truth · (1 + error + nonlinearity · truth / 300 kPa), as data \
                     sheets of pressure sensors state both.",
            leaves_out: "hysteresis of the sensor",
            build: &|values| {
                Term::Sensor(Box::new(PressureSensorGain {
                    gain_error: values[0],
                    nonlinearity: values[1],
                }))
            },
            observation: None,
        },
    ],
};

const GAIN_ERROR: Parameter = Parameter::new("gain_error", "1", (-0.4, 0.4), 0.02).neutral(0.0);

/// Relative error at 300 kPa \[-\], at which both terms have the sizes that the parameters state.
fn error_at_reference(effect: &Effect) -> f64 {
    effect.value("gain_error").unwrap_or(0.0) + effect.value("nonlinearity").unwrap_or(0.0)
}

struct PressureSensorGain {
    gain_error: f64,
    nonlinearity: f64,
}

impl Dynamics<SensorPoint> for PressureSensorGain {}

impl SensorTerm for PressureSensorGain {
    fn read(&self, point: &SensorPoint, _: &[f64], reading: &mut Reading) {
        let truth_pa = point.truth.pressure.0;
        let error = self.gain_error + self.nonlinearity * truth_pa / REFERENCE_PRESSURE_PA;
        reading.pressure.0 += truth_pa * error;
    }
}

#[cfg(test)]
mod tests {
    use super::super::testing::{assert_near, effect, read_and_inverted, truth};
    use super::KIND;

    #[test]
    fn the_reading_is_its_formula_and_is_inverted() {
        let proportional = || effect(&KIND, "proportional", &[("gain_error", 0.05)]);
        let parameters = [("gain_error", 0.03), ("nonlinearity", 0.02)];
        let quadratic = || effect(&KIND, "quadratic", &parameters);
        for (gain, true_pa, expected_pa) in [
            (proportional(), 1e5, 1.05e5),
            (proportional(), 3e5, 3.15e5),
            (quadratic(), 1e5, 1e5 * (1.03 + 0.02 / 3.0)),
            (quadratic(), 3e5, 3.15e5),
        ] {
            let [read, inverted] = read_and_inverted(&gain, 0.0, truth(true_pa, 0.1));
            assert_near(read.pressure.0, expected_pa, 1e-6, "reading");
            assert_eq!((read.contraction, read.force_n), (0.1, 200.0));
            assert_near(inverted.pressure.0, true_pa, 1e-6, "truth");
        }
    }
}
