//! Errors of the sensors.

use serde::Serialize;

use super::{Drawn, Form, between, scale, sign};
use crate::hidden::{Hidden, Moment, Reading};

/// Reading higher by this.
#[derive(Serialize)]
struct PressureOffset {
    offset_pa: f64,
}

impl Hidden for PressureOffset {
    fn read(&self, reading: &mut Reading, _: &Moment, _: &[f64]) {
        reading.pressure_pa += self.offset_pa;
    }
}

pub(super) const PRESSURE_OFFSET: &[Form] = &[Form::standard(
    "constant",
    &["offset_pa"],
    |size, _, rng| {
        Drawn::new(PressureOffset {
            offset_pa: sign(rng) * scale(size, 0.4e3, 15.0e3),
        })
    },
)];

/// A gain error, and a nonlinearity.
#[derive(Serialize)]
struct PressureGain {
    gain: f64,
    bend_per_pa: f64,
}

impl Hidden for PressureGain {
    fn read(&self, reading: &mut Reading, _: &Moment, _: &[f64]) {
        reading.pressure_pa *= self.gain + self.bend_per_pa * reading.pressure_pa;
    }
}

pub(super) const PRESSURE_GAIN: &[Form] = &[
    Form::standard("linear", &["gain"], |size, _, rng| {
        let gain = 1.0 + sign(rng) * scale(size, 0.002, 0.03);
        Drawn::new(PressureGain {
            gain,
            bend_per_pa: 0.0,
        })
    }),
    Form::new("bent", |size, _, rng| {
        let off = sign(rng) * scale(size, 0.002, 0.03);
        // bent by a fifth to two fifths of the error at 300 kPa
        let bend_per_pa = off * between(rng, 0.2, 0.4) / 3.0e5;
        Drawn::new(PressureGain {
            gain: 1.0 + off,
            bend_per_pa,
        })
    }),
];

/// Steady drift.
#[derive(Serialize)]
struct SteadyDrift {
    drift_pa_per_s: f64,
}

impl Hidden for SteadyDrift {
    fn read(&self, reading: &mut Reading, now: &Moment, _: &[f64]) {
        reading.pressure_pa += self.drift_pa_per_s * now.time_s.max(0.0);
    }
}

/// Drift that decays while the sensor warms up.
#[derive(Serialize)]
struct WarmUpDrift {
    final_pa: f64,
    time_constant_s: f64,
}

impl Hidden for WarmUpDrift {
    fn read(&self, reading: &mut Reading, now: &Moment, _: &[f64]) {
        let share = -(-now.time_s.max(0.0) / self.time_constant_s).exp_m1();
        reading.pressure_pa += self.final_pa * share;
    }
}

/// Drift that speeds up.
#[derive(Serialize)]
struct GrowingDrift {
    drift_pa_per_s: f64,
    growth_pa_per_s2: f64,
}

impl Hidden for GrowingDrift {
    fn read(&self, reading: &mut Reading, now: &Moment, _: &[f64]) {
        let time_s = now.time_s.max(0.0);
        reading.pressure_pa += (self.drift_pa_per_s + self.growth_pa_per_s2 * time_s) * time_s;
    }
}

pub(super) const PRESSURE_DRIFT: &[Form] = &[
    Form::standard("steady", &["drift_pa_per_s"], |size, _, rng| {
        Drawn::new(SteadyDrift {
            drift_pa_per_s: sign(rng) * scale(size, 20.0, 400.0),
        })
    }),
    Form::new("warm-up", |size, _, rng| {
        Drawn::new(WarmUpDrift {
            final_pa: sign(rng) * scale(size, 0.8e3, 15.0e3),
            time_constant_s: between(rng, 12.0, 40.0),
        })
    }),
    Form::new("growing", |size, _, rng| {
        let drift_pa_per_s = sign(rng) * scale(size, 10.0, 200.0);
        let growth_pa_per_s2 = drift_pa_per_s * between(rng, 0.015, 0.03);
        Drawn::new(GrowingDrift {
            drift_pa_per_s,
            growth_pa_per_s2,
        })
    }),
];

/// A wrong home position.
#[derive(Serialize)]
struct ContractionOffset {
    offset: f64,
}

impl Hidden for ContractionOffset {
    fn read(&self, reading: &mut Reading, _: &Moment, _: &[f64]) {
        reading.contraction += self.offset;
    }
}

pub(super) const CONTRACTION_OFFSET: &[Form] =
    &[Form::standard("constant", &["offset"], |size, _, rng| {
        Drawn::new(ContractionOffset {
            offset: sign(rng) * scale(size, 0.0004, 0.02),
        })
    })];
