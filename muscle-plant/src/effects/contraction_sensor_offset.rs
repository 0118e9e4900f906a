//! `contraction-sensor-offset`: the encoder's zero is off, as after a lost homing.

use super::{CompensationMethod, EffectKind, Equation, Form, Parameter, Requirement};
use crate::subsystem::sensors::{Reading, SensorPoint, SensorTerm};
use crate::subsystem::term::Dynamics;
use crate::subsystem::{Subsystem, Term};

/// The kind, for the catalogue.
pub static KIND: EffectKind = EffectKind {
    name: "contraction-sensor-offset",
    subsystem: Subsystem::Sensor,
    equations: &[Equation::Gas, Equation::MuscleForce, Equation::Load],
    requires: &[Requirement::Vented],
    signature: "The force law holds at a shifted contraction; the dynamics are unchanged.",
    test_signal: "the muscle vented and hung free: the encoder must read zero.",
    discrepancy_ratio: 0.0,
    law_quantities: &[],
    compensation: CompensationMethod::Unavailable(
        "not needed: the self-check sets the encoder's zero where the weight rests",
    ),
    forms: &[Form {
        name: "constant",
        parameters: &[Parameter::new("offset", "1", (-0.2, 0.2), 0.01).neutral(0.0)],
        equation: "Reading = ε + offset",
        source: "Reading = truth + offset, in contraction.",
        leaves_out: "counts that are lost during motion",
        build: &|values| Term::Sensor(Box::new(ContractionSensorOffset { offset: values[0] })),
        observation: None,
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

#[cfg(test)]
mod tests {
    use super::super::testing::{assert_near, effect, read_and_inverted, truth};
    use super::KIND;

    #[test]
    fn the_offset_is_added_to_the_contraction_and_removed_again() {
        let offset = effect(&KIND, "constant", &[("offset", 0.01)]);
        let [read, inverted] = read_and_inverted(&offset, 0.0, truth(2e5, 0.1));
        assert_near(read.contraction, 0.11, 1e-12, "reading");
        assert_eq!((read.pressure.0, read.force_n), (2e5, 200.0));
        assert_near(inverted.contraction, 0.1, 1e-12, "truth");
    }
}
