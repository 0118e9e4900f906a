//! `pressure-sensor-drift`: the zero of the pressure sensor drifts.

use super::{
    CompensationMethod, DISCREPANCY_RATIO, EffectKind, Equation, Form, Parameter, Quantity,
};
use crate::subsystem::sensors::{Reading, SensorPoint, SensorTerm};
use crate::subsystem::term::Dynamics;
use crate::subsystem::{Subsystem, Term};

const DRIFT_PA_PER_S: Parameter =
    Parameter::new("drift_pa_per_s", "Pa/s", (-1e4, 1e4), 100.0).neutral(0.0);

/// The kind, for the catalogue.
pub static KIND: EffectKind = EffectKind {
    name: "pressure-sensor-drift",
    subsystem: Subsystem::Sensor,
    equations: &[Equation::Gas, Equation::MuscleForce],
    requires: &[],
    signature: "The reading drifts away from the true pressure, with which force and contraction \
                agree.",
    test_signal: "a vented zero before and after a hold of ten minutes.",
    discrepancy_ratio: DISCREPANCY_RATIO,
    law_quantities: &[Quantity::Pressure],
    compensation: CompensationMethod::Unavailable("it differs from run to run"),
    forms: &[
        Form {
            name: "linear",
            parameters: &[DRIFT_PA_PER_S],
            equation: "Reading = P + drift_pa_per_s · t",
            source: "An offset proportional to the record's time, 0 at time 0.",
            leaves_out: "a drift that ends",
            build: &|values| drift(values[0], 0.0, f64::INFINITY),
            observation: None,
        },
        Form {
            name: "quadratic",
            parameters: &[
                DRIFT_PA_PER_S,
                Parameter::new("growth_pa_per_s2", "Pa/s²", (-1e3, 1e3), 5.0).neutral(0.0),
            ],
            equation: "Reading = P + drift_pa_per_s · t + growth_pa_per_s2 · t²/2",
            source: "An offset, 0 at the record's time 0, with a given rate there that grows \
                     linearly: the next term of a slow drift.",
            leaves_out: "a drift that ends",
            build: &|values| drift(values[0], values[1], f64::INFINITY),
            observation: None,
        },
        Form {
            name: "warm-up",
            parameters: &[
                Parameter::new("drift_pa", "Pa", (-1e5, 1e5), 3e3).neutral(0.0),
                // A faster warm-up is an offset.
                Parameter::new("time_constant_s", "s", (2.0, 1e4), 20.0)
                    .log()
                    .physical_min(),
            ],
            equation: "Reading = P + drift_pa · (1 − exp(−t/time_constant_s))",
            source: "An offset that approaches its size exponentially from 0 at the record's time \
                     0.",
            leaves_out: "a temperature that depends on the use",
            build: &|values| drift(values[0] / values[1], 0.0, values[1]),
            observation: None,
        },
    ],
};

fn drift(drift_pa_per_s: f64, growth_pa_per_s2: f64, time_constant_s: f64) -> Term {
    Term::Sensor(Box::new(Drift {
        drift_pa_per_s,
        growth_pa_per_s2,
        time_constant_s,
    }))
}

struct Drift {
    /// Rate of the offset at time 0.
    drift_pa_per_s: f64,
    /// Growth of that rate.
    growth_pa_per_s2: f64,
    /// Infinite for a drift that does not end.
    time_constant_s: f64,
}

impl Dynamics<SensorPoint> for Drift {}

impl SensorTerm for Drift {
    fn read(&self, point: &SensorPoint, _: &[f64], reading: &mut Reading) {
        let passed_s = if self.time_constant_s.is_finite() {
            // No drift before time 0.
            let times = point.time_s.max(0.0) / self.time_constant_s;
            -self.time_constant_s * (-times).exp_m1()
        } else {
            point.time_s
        };
        let mean_pa_per_s = self.drift_pa_per_s + 0.5 * self.growth_pa_per_s2 * passed_s;
        reading.pressure.0 += mean_pa_per_s * passed_s;
    }
}

#[cfg(test)]
mod tests {
    use super::super::testing::{assert_near, effect, read_and_inverted, truth};
    use super::KIND;
    use crate::effects::Effect;

    fn assert_drift(drift: Effect, drift_pa: impl Fn(f64) -> f64) {
        for time_s in [0.0, 0.7, 5.0] {
            let [read, inverted] = read_and_inverted(&drift, time_s, truth(2e5, 0.1));
            assert_near(read.pressure.0, 2e5 + drift_pa(time_s), 1e-6, "reading");
            assert_eq!((read.contraction, read.force_n), (0.1, 200.0));
            assert_near(inverted.pressure.0, 2e5, 1e-6, "truth");
        }
    }

    #[test]
    fn the_offset_is_its_formula_in_time_and_is_removed_again() {
        let linear = effect(&KIND, "linear", &[("drift_pa_per_s", 200.0)]);
        assert_drift(linear, |time_s| 200.0 * time_s);
        let parameters = [("drift_pa_per_s", 200.0), ("growth_pa_per_s2", -30.0)];
        assert_drift(effect(&KIND, "quadratic", &parameters), |time_s| {
            200.0 * time_s - 15.0 * time_s * time_s
        });
        let parameters = [("drift_pa", 4e3), ("time_constant_s", 2.0)];
        assert_drift(effect(&KIND, "warm-up", &parameters), |time_s| {
            4e3 * (1.0 - (-time_s / 2.0).exp())
        });
    }
}
