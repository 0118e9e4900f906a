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
    requires: &[Requirement::MeasuredForce, Requirement::Vented],
    signature: "The reading is off by the same amount everywhere, also where the muscle is slack.",
    test_signal: "the force of the unmounted sensor, and of the vented muscle at each length.",
    discrepancy_ratio: 0.0,
    law_quantities: &[],
    compensation: CompensationMethod::Unavailable("the controller does not use the force sensor"),
    forms: &[Form {
        name: "constant",
        parameters: &[Parameter::new("offset_n", "N", (-1e3, 1e3), 10.0).neutral(0.0)],
        equation: "Reading = F + offset_n",
        source: "Reading = truth + offset: the load cell's zero balance, mounting and tare (ISO \
                 376).",
        leaves_out: "gain and drift",
        build: &|values| {
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

#[cfg(test)]
mod tests {
    use super::super::slack;
    use super::super::testing::{STEP_S, bench, effect, force_n};
    use super::KIND;

    /// Slack limits the force and not its reading.
    #[test]
    fn the_offset_is_read_also_where_the_muscle_is_slack() {
        let inputs = bench(STEP_S, 101, |_| 0.2, |time_s| 3e5 * time_s);
        let loose = effect(&slack::KIND, "sharp", &[]);
        let offset = effect(&KIND, "constant", &[("offset_n", -7.0)]);
        let true_n = force_n(std::slice::from_ref(&loose), &inputs);
        let read_n = force_n(&[offset, loose], &inputs);
        assert!(true_n[0] == 0.0 && true_n[100] > 100.0);
        let errors_n = true_n.iter().zip(&read_n).map(|(truth, read)| read - truth);
        assert!(
            errors_n
                .map(|error_n| error_n + 7.0)
                .all(|n| n.abs() < 1e-9)
        );
    }
}
