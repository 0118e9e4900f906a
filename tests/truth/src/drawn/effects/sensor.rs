//! Errors of the sensors.

use rand::RngExt;
use rand_pcg::Pcg64;
use serde::Serialize;

use super::super::bench::Bench;
use super::super::shape::{Curve, Ramp, between, log_between, log_scale, sign};
use super::Law;
use crate::hidden::{Hidden, Moment, Reading};

/// Readings higher by these.
#[derive(Serialize)]
struct Offset {
    pressure_pa: f64,
    contraction: f64,
    force_n: f64,
}

impl Hidden for Offset {
    fn commits(&self) -> bool {
        false
    }
    fn read(&self, reading: &mut Reading, _: &Moment, _: &[f64]) {
        reading.pressure_pa += self.pressure_pa;
        reading.contraction += self.contraction;
        reading.force_n += self.force_n;
    }
}

const NO_OFFSET: Offset = Offset {
    pressure_pa: 0.0,
    contraction: 0.0,
    force_n: 0.0,
};

pub(super) fn pressure_offset(_: &Bench, size: f64, rng: &mut Pcg64) -> Law {
    let pressure_pa = sign(rng) * log_scale(size, 0.5e3, 15.0e3);
    let words = format!("reads {pressure_pa:.0} Pa too much");
    let effect = Offset {
        pressure_pa,
        ..NO_OFFSET
    };
    Law::new(effect, "constant", words)
}

pub(super) fn contraction_offset(_: &Bench, size: f64, rng: &mut Pcg64) -> Law {
    let contraction = sign(rng) * log_scale(size, 0.001, 0.02);
    let words = format!("reads {contraction:.4} too much");
    let effect = Offset {
        contraction,
        ..NO_OFFSET
    };
    Law::new(effect, "constant", words)
}

pub(super) fn force_offset(bench: &Bench, size: f64, rng: &mut Pcg64) -> Law {
    let force_n = sign(rng) * log_scale(size, 0.01, 0.2) * bench.weight_n();
    let words = format!("reads {force_n:.1} N too much");
    let effect = Offset {
        force_n,
        ..NO_OFFSET
    };
    Law::new(effect, "constant", words)
}

/// An error that grows with pressure, not quite in proportion.
#[derive(Serialize)]
struct Gain {
    error: f64,
    along: Curve,
    high_pa: f64,
}

impl Hidden for Gain {
    fn commits(&self) -> bool {
        false
    }
    fn read(&self, reading: &mut Reading, _: &Moment, _: &[f64]) {
        let u = reading.pressure_pa / self.high_pa;
        reading.pressure_pa *= 1.0 + self.error * self.along.at(u);
    }
}

pub(super) fn pressure_gain(bench: &Bench, size: f64, rng: &mut Pcg64) -> Law {
    let error = sign(rng) * log_scale(size, 0.003, 0.04);
    let along = if rng.random_bool(0.5) {
        Curve::draw(rng, 1.6)
    } else {
        Curve::flat()
    };
    let words = format!(
        "reads {:.2} % too much, by a factor of {:.2} along pressure",
        100.0 * error,
        along.ratio()
    );
    let high_pa = bench.rig.supply_pressure_pa;
    Law::new(
        Gain {
            error,
            along,
            high_pa,
        },
        "proportional",
        words,
    )
}

/// Drift from nothing at the record's first sample, always the same way.
#[derive(Serialize)]
struct Drift {
    /// At the time where the shape is one.
    drift_pa: f64,
    over_s: f64,
    /// Time constant of a sensor that warms up, instead of the shape.
    warm_up_s: Option<f64>,
    shape: Ramp,
}

impl Drift {
    fn off_pa(&self, time_s: f64) -> f64 {
        let time_s = time_s.max(0.0);
        let share = match self.warm_up_s {
            Some(warm_up_s) => -(-time_s / warm_up_s).exp_m1(),
            None => self.shape.at(time_s / self.over_s),
        };
        self.drift_pa * share
    }
}

impl Hidden for Drift {
    fn commits(&self) -> bool {
        false
    }
    fn read(&self, reading: &mut Reading, now: &Moment, _: &[f64]) {
        reading.pressure_pa += self.off_pa(now.time_s);
    }
}

pub(super) fn pressure_drift(_: &Bench, size: f64, rng: &mut Pcg64) -> Law {
    let over_s = log_between(rng, 20.0, 100.0);
    let drift_pa = sign(rng) * log_scale(size, 1.0e3, 15.0e3);
    let warm_up_s = rng.random_bool(0.3).then(|| between(rng, 10.0, 40.0));
    let form = if warm_up_s.is_some() {
        "warm-up"
    } else {
        "monotone"
    };
    let words = format!("reads {drift_pa:.0} Pa too much after some {over_s:.0} s");
    Law::new(
        Drift {
            drift_pa,
            over_s,
            warm_up_s,
            shape: Ramp::draw(rng, 3.0),
        },
        form,
        words,
    )
}
