//! The valve: lag, dead zone, flow limit.

use std::f64::consts::TAU;

use rand::RngExt;
use rand_pcg::Pcg64;
use serde::Serialize;

use super::super::bench::Bench;
use super::super::shape::{Coordinate, Modulation, between, log_between, log_scale, shares};
use super::Law;
use crate::hidden::{Hidden, Moment};

/// Linear filter of the reference.
#[derive(Serialize)]
#[serde(rename_all = "kebab-case")]
enum Filter {
    /// First-order lags, one after the other.
    Cascade { time_constant_s: Vec<f64> },
    /// Shares that lag by time constants of their own.
    Parallel {
        time_constant_s: Vec<f64>,
        share: Vec<f64>,
    },
    /// A servo loop of second order.
    Servo { frequency_hz: f64, damping: f64 },
}

/// Lag of the reference.
#[derive(Serialize)]
struct Lag {
    filter: Filter,
    /// How much faster it follows a rise than a fall.
    faster_up: f64,
    /// Of its speed.
    modulation: Modulation,
}

/// States: outputs of the lags, or output and rate of the servo loop.
impl Hidden for Lag {
    fn commits(&self) -> bool {
        false
    }
    fn states(&self) -> usize {
        match &self.filter {
            Filter::Cascade { time_constant_s } => time_constant_s.len(),
            Filter::Parallel { share, .. } => share.len(),
            Filter::Servo { .. } => 2,
        }
    }
    fn settle(&self, now: &Moment, x: &mut [f64]) {
        x.fill(now.command_pa);
        if let Filter::Servo { .. } = self.filter {
            x[1] = 0.0;
        }
    }
    fn reference_pa(&self, reference_pa: f64, now: &Moment, x: &[f64], dx: &mut [f64]) -> f64 {
        let faster = self.modulation.at(now);
        let follow = |off_pa: f64, time_constant_s: f64| {
            let way = if off_pa > 0.0 { self.faster_up } else { 1.0 };
            faster * way * off_pa / time_constant_s
        };
        match &self.filter {
            Filter::Cascade { time_constant_s } => {
                let mut before_pa = reference_pa;
                for (i, time_constant_s) in time_constant_s.iter().enumerate() {
                    dx[i] = follow(before_pa - x[i], *time_constant_s);
                    before_pa = x[i];
                }
                before_pa
            }
            Filter::Parallel {
                time_constant_s,
                share,
            } => {
                let mut sum_pa = 0.0;
                for i in 0..share.len() {
                    dx[i] = follow(reference_pa - x[i], time_constant_s[i]);
                    sum_pa += share[i] * x[i];
                }
                sum_pa
            }
            Filter::Servo {
                frequency_hz,
                damping,
            } => {
                let angular = faster * TAU * frequency_hz;
                dx[0] = x[1];
                dx[1] = angular * (angular * (reference_pa - x[0]) - 2.0 * damping * x[1]);
                x[0]
            }
        }
    }
}

pub(super) fn lag(bench: &Bench, size: f64, rng: &mut Pcg64) -> Law {
    let lag_s = log_scale(size, 0.006, 0.1);
    let count = rng.random_range(1..=3);
    let parts = shares(rng, count);
    let (filter, form) = match rng.random_range(0..3) {
        0 => {
            let time_constant_s = parts
                .iter()
                .map(|part| (part * lag_s).max(1.0e-3))
                .collect();
            (Filter::Cascade { time_constant_s }, "cascade")
        }
        1 => {
            let raw: Vec<f64> = (0..count).map(|_| log_between(rng, 0.3, 3.0)).collect();
            let mean: f64 = raw.iter().zip(&parts).map(|(t, share)| t * share).sum();
            let time_constant_s = raw.iter().map(|t| t / mean * lag_s).collect();
            let share = parts;
            let filter = Filter::Parallel {
                time_constant_s,
                share,
            };
            (filter, "parallel")
        }
        _ => {
            let damping = between(rng, 0.55, 1.2);
            let frequency_hz = 2.0 * damping / (lag_s * TAU);
            let filter = Filter::Servo {
                frequency_hz,
                damping,
            };
            (filter, "servo")
        }
    };
    let faster_up = if form != "servo" && rng.random_bool(0.4) {
        log_between(rng, 0.5, 2.0)
    } else {
        1.0
    };
    let modulation = Modulation::draw(rng, &[Coordinate::Pressure], bench);
    let words = format!(
        "{:.1} ms in all, {faster_up:.2} times as fast up as down{}",
        1e3 * lag_s,
        modulation.words()
    );
    Law::new(
        Lag {
            filter,
            faster_up,
            modulation,
        },
        form,
        words,
    )
}

/// Dead zone: small errors open the valve little or not at all.
#[derive(Serialize)]
struct DeadZone {
    /// Half of the zone, for filling and for exhausting.
    width_pa: [f64; 2],
    /// Over the width: how round the corner is.
    rounding: f64,
    /// Share of the nominal flow that passes inside.
    inside: f64,
    modulation: Modulation,
    #[serde(skip)]
    flow_gain_kg_per_pa_s: f64,
}

impl DeadZone {
    fn opened_pa(&self, error_pa: f64, width_pa: f64) -> f64 {
        let corner_pa = self.rounding * width_pa;
        let soft_pa = |past_pa: f64| {
            past_pa.max(0.0) + corner_pa * (-past_pa.abs() / corner_pa).exp().ln_1p()
        };
        // shut without an error, whatever the corner
        let past_pa = soft_pa(error_pa - width_pa) - soft_pa(-width_pa);
        self.inside * error_pa + (1.0 - self.inside) * past_pa
    }
}

impl Hidden for DeadZone {
    fn commits(&self) -> bool {
        false
    }
    fn flow_kg_per_s(&self, flow: f64, now: &Moment, _: &[f64], _: &mut [f64]) -> f64 {
        let error_pa = flow / self.flow_gain_kg_per_pa_s;
        let width_pa = self.width_pa[usize::from(flow < 0.0)] * self.modulation.at(now);
        let opened_pa = self.opened_pa(error_pa.abs(), width_pa);
        self.flow_gain_kg_per_pa_s * opened_pa.copysign(error_pa)
    }
}

pub(super) fn dead_zone(bench: &Bench, size: f64, rng: &mut Pcg64) -> Law {
    let width_pa = log_scale(size, 0.8e3, 16.0e3);
    let asymmetry = if rng.random_bool(0.6) {
        log_between(rng, 0.4, 2.5)
    } else {
        1.0
    };
    let rounding = log_between(rng, 0.01, 0.5);
    let inside = if rng.random_bool(0.4) {
        between(rng, 0.0, 0.08)
    } else {
        0.0
    };
    let modulation = Modulation::draw(rng, &[Coordinate::Pressure], bench);
    let words = format!(
        "{width_pa:.0} Pa filling and {asymmetry:.2} of it exhausting, rounded over {rounding:.2} \
         of the width{}",
        modulation.words()
    );
    Law::new(
        DeadZone {
            width_pa: [width_pa, asymmetry * width_pa],
            rounding,
            inside,
            modulation,
            flow_gain_kg_per_pa_s: bench.rig.flow_gain_kg_per_pa_s,
        },
        if rounding < 0.1 { "sharp" } else { "rounded" },
        words,
    )
}

/// Flow limited by a restriction, different in each direction.
#[derive(Serialize)]
struct FlowLimit {
    /// Over upstream absolute pressure, filling and exhausting.
    conductance_kg_per_pa_s: [f64; 2],
    critical_ratio: f64,
    /// Of the subsonic branch; one half is an ellipse.
    exponent: f64,
    /// How flow and limit combine: as a norm of this power, sharp for a large one.
    power: f64,
    modulation: Modulation,
    #[serde(skip)]
    supply_absolute_pa: f64,
    #[serde(skip)]
    atmospheric_pa: f64,
}

impl FlowLimit {
    fn passed(&self, upstream_pa: f64, downstream_pa: f64) -> f64 {
        let ratio = downstream_pa / upstream_pa;
        let over = ((ratio - self.critical_ratio) / (1.0 - self.critical_ratio)).clamp(0.0, 1.0);
        (1.0 - over * over).powf(self.exponent) * upstream_pa
    }
}

impl Hidden for FlowLimit {
    fn commits(&self) -> bool {
        false
    }
    fn flow_kg_per_s(&self, flow: f64, now: &Moment, _: &[f64], _: &mut [f64]) -> f64 {
        let muscle_pa = (now.pressure_pa + self.atmospheric_pa).max(1.0);
        let open_pa = if flow > 0.0 {
            self.passed(self.supply_absolute_pa, muscle_pa)
        } else {
            self.passed(muscle_pa, self.atmospheric_pa)
        };
        let conductance = self.conductance_kg_per_pa_s[usize::from(flow < 0.0)];
        let most = conductance * self.modulation.at(now) * open_pa;
        if most <= 0.0 || flow == 0.0 {
            return 0.0;
        }
        let over = (flow.abs() / most).powf(self.power);
        flow / (1.0 + over).powf(self.power.recip())
    }
}

pub(super) fn flow_limit(bench: &Bench, size: f64, rng: &mut Pcg64) -> Law {
    let rig = &bench.rig;
    // the error of pressure above which the limit holds
    let error_pa = log_scale(size, 0.5, 0.05) * (bench.high_pa - bench.lift_pa);
    let limit = rig.flow_gain_kg_per_pa_s * error_pa;
    let supply_absolute_pa = rig.supply_pressure_pa + rig.atmospheric_pressure_pa;
    let fill = limit / supply_absolute_pa;
    let exhaust = limit / (bench.middle_pa() + rig.atmospheric_pressure_pa);
    let modulation = Modulation::draw(rng, &[Coordinate::Pressure], bench);
    let power = log_between(rng, 1.5, 12.0);
    let words = format!(
        "about {:.2e} kg/s, reached with a norm of power {power:.1}{}",
        limit,
        modulation.words()
    );
    Law::new(
        FlowLimit {
            conductance_kg_per_pa_s: [fill, exhaust * log_between(rng, 0.6, 1.7)],
            critical_ratio: between(rng, 0.15, 0.55),
            exponent: between(rng, 0.4, 0.65),
            power,
            modulation,
            supply_absolute_pa,
            atmospheric_pa: rig.atmospheric_pressure_pa,
        },
        if power > 5.0 { "sharp" } else { "smooth" },
        words,
    )
}
