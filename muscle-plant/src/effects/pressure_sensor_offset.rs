//! `pressure-sensor-offset`: the pressure sensor's zero is off.

use super::{CompensationMethod, EffectKind, Equation, Form, Parameter, Requirement};
use crate::subsystem::sensors::{Reading, SensorPoint, SensorTerm};
use crate::subsystem::term::Dynamics;
use crate::subsystem::{Subsystem, Term};

/// The kind, for the catalogue.
pub static KIND: EffectKind = EffectKind {
    name: "pressure-sensor-offset",
    subsystem: Subsystem::Sensor,
    equations: &[Equation::Gas, Equation::MuscleForce],
    requires: &[Requirement::Vented],
    signature: "The reading differs by a constant from the true pressure, with which force and \
                contraction agree.",
    test_signal: "a vented zero, and one known pressure from a gauge.",
    discrepancy_ratio: 0.0,
    law_quantities: &[],
    compensation: CompensationMethod::PressureSensorOffset(|effect| {
        effect.value("offset_pa").unwrap_or(0.0)
    }),
    forms: &[Form {
        name: "constant",
        parameters: &[Parameter::new("offset_pa", "Pa", (-1e5, 1e5), 5e3).neutral(0.0)],
        equation: "Reading = P + offset_pa",
        source: "Reading = truth + offset.",
        leaves_out: "gain and drift, which are effects of their own",
        build: &|values| {
            Term::Sensor(Box::new(PressureSensorOffset {
                offset_pa: values[0],
            }))
        },
        observation: None,
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

#[cfg(test)]
mod tests {
    use super::super::testing::{assert_near, effect, read_and_inverted, truth};
    use super::KIND;

    #[test]
    fn the_offset_is_added_to_the_pressure_and_removed_again() {
        let offset = effect(&KIND, "constant", &[("offset_pa", 3e3)]);
        let [read, inverted] = read_and_inverted(&offset, 0.0, truth(2e5, 0.1));
        assert_near(read.pressure.0, 2.03e5, 1e-6, "reading");
        assert_eq!((read.contraction, read.force_n), (0.1, 200.0));
        assert_near(inverted.pressure.0, 2e5, 1e-6, "truth");
    }
}
