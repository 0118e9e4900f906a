//! `pressure-sensor-drift`: the pressure sensor's zero moves.

use super::{EffectKind, Form, Parameter};
use crate::subsystem::Term;
use crate::subsystem::sensors::{Reading, SensorPoint, SensorTerm};
use crate::subsystem::term::Dynamics;

const DRIFT_PA_PER_S: Parameter =
    Parameter::new("drift_pa_per_s", "Pa/s", (-1e4, 1e4), 100.0).neutral(0.0);

pub(super) const KIND: EffectKind = EffectKind {
    name: "pressure-sensor-drift",
    place: "sensor",
    signature: "The reading drifts away from force and contraction, which stay with the true pressure.",
    test_signal: "a vented zero before and after a hold of ten minutes.",
    forms: &[
        Form {
            name: "linear",
            parameters: &[DRIFT_PA_PER_S],
            source: "An offset in proportion to the record's time, none at time 0. Leaves out a \
                     drift that comes to rest.",
            build: |values| drift(values[0], 0.0, f64::INFINITY),
        },
        Form {
            name: "quadratic",
            parameters: &[
                DRIFT_PA_PER_S,
                Parameter::new("growth_pa_per_s2", "Pa/s²", (-1e3, 1e3), 5.0).neutral(0.0),
            ],
            source: "An offset, none at the record's time 0, whose rate there is given and grows \
                     steadily: the next term of a slow drift. Leaves out a drift that comes to \
                     rest.",
            build: |values| drift(values[0], values[1], f64::INFINITY),
        },
        Form {
            name: "warm-up",
            parameters: &[
                Parameter::new("drift_pa", "Pa", (-1e5, 1e5), 3e3).neutral(0.0),
                // Faster than this it is an offset.
                Parameter::new("time_constant_s", "s", (2.0, 1e4), 20.0)
                    .log()
                    .ends_at_min(),
            ],
            source: "An offset that approaches its size exponentially from none at the record's \
                     time 0. Leaves out a temperature that follows the use.",
            build: |values| drift(values[0] / values[1], 0.0, values[1]),
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
    /// At time 0.
    drift_pa_per_s: f64,
    /// By how much that grows.
    growth_pa_per_s2: f64,
    /// Infinite where it does not come to rest.
    time_constant_s: f64,
}

impl Dynamics<SensorPoint> for Drift {}

impl SensorTerm for Drift {
    fn read(&self, at: &SensorPoint, _: &[f64], reading: &mut Reading) {
        let passed_s = if self.time_constant_s.is_finite() {
            // Before time 0 nothing has drifted.
            let times = at.time_s.max(0.0) / self.time_constant_s;
            -self.time_constant_s * (-times).exp_m1()
        } else {
            at.time_s
        };
        let mean_pa_per_s = self.drift_pa_per_s + 0.5 * self.growth_pa_per_s2 * passed_s;
        reading.pressure.0 += mean_pa_per_s * passed_s;
    }
}
