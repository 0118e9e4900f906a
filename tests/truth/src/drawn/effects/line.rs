//! The line: delay of the command, and dynamics of hose and sensor port.

use std::f64::consts::TAU;

use rand::RngExt;
use rand_pcg::Pcg64;
use serde::Serialize;

use super::super::bench::Bench;
use super::super::shape::{Curve, between, log_between, log_scale, shares};
use super::Law;
use crate::hidden::{Hidden, Moment, Reading};
use crate::machine::GAS_CONSTANT_J_PER_KG_K;

/// The command arrives later, in parts, fetched by a poll, or smeared.
#[derive(Serialize)]
struct Delay {
    /// Until anything arrives, and what share arrives when.
    arrivals: Vec<(f64, f64)>,
    /// Period of the poll, if there is one.
    #[serde(skip_serializing_if = "Option::is_none")]
    poll_s: Option<f64>,
    /// Mean of the smear and its stages.
    smear_s: f64,
    stages: usize,
}

/// States: stages of the smear.
impl Hidden for Delay {
    fn commits(&self) -> bool {
        false
    }
    fn states(&self) -> usize {
        self.stages
    }
    fn settle(&self, now: &Moment, x: &mut [f64]) {
        x.fill(now.command_pa);
    }
    fn arrivals(&self, sent_s: f64) -> Vec<(f64, f64)> {
        let taken_s = match self.poll_s {
            Some(period_s) => (sent_s / period_s - 1.0e-9).ceil() * period_s,
            None => sent_s,
        };
        let arrivals = self.arrivals.iter();
        arrivals
            .map(|(late_s, share)| (taken_s + late_s, *share))
            .collect()
    }
    fn reference_pa(&self, reference_pa: f64, _: &Moment, x: &[f64], dx: &mut [f64]) -> f64 {
        let mut before_pa = reference_pa;
        for i in 0..self.stages {
            dx[i] = self.stages as f64 * (before_pa - x[i]) / self.smear_s;
            before_pa = x[i];
        }
        before_pa
    }
}

pub(super) fn delay(_: &Bench, size: f64, rng: &mut Pcg64) -> Law {
    let delay_s = log_scale(size, 0.008, 0.1);
    let mut effect = Delay {
        arrivals: vec![(delay_s, 1.0)],
        poll_s: None,
        smear_s: 0.0,
        stages: 0,
    };
    let form = match rng.random_range(0..4) {
        0 => "pure",
        1 => {
            // of several paths the first brings the largest part
            let count = rng.random_range(2..=4);
            let mut parts = shares(rng, count);
            parts.sort_by(|a, b| b.total_cmp(a));
            let late = |(i, share): (usize, f64)| (delay_s * (1.0 + 0.12 * i as f64), share);
            effect.arrivals = parts.into_iter().enumerate().map(late).collect();
            "paths"
        }
        2 => {
            effect.poll_s = Some(delay_s * between(rng, 0.15, 0.5));
            "polled"
        }
        _ => {
            effect.smear_s = delay_s * between(rng, 0.05, 0.25);
            effect.stages = rng.random_range(2..=4);
            "smeared"
        }
    };
    Law::new(
        effect,
        form,
        format!("nothing moves for {:.1} ms", 1e3 * delay_s),
    )
}

/// One mode of the air column between muscle and sensor.
#[derive(Serialize)]
struct Mode {
    share: f64,
    frequency_hz: f64,
    damping: f64,
    /// Damping that grows with the amplitude's power, at 10 kPa.
    turbulent: f64,
    power: f64,
}

/// The reading rings about the muscle's pressure; the muscle does not.
#[derive(Serialize)]
struct Ringing {
    modes: Vec<Mode>,
}

/// States: pressure of each mode, and its rate.
impl Hidden for Ringing {
    fn commits(&self) -> bool {
        false
    }
    fn states(&self) -> usize {
        2 * self.modes.len()
    }
    fn settle(&self, now: &Moment, x: &mut [f64]) {
        for mode in x.chunks_exact_mut(2) {
            mode.copy_from_slice(&[now.pressure_pa, 0.0]);
        }
    }
    fn heat_w(&self, heat_w: f64, now: &Moment, x: &[f64], dx: &mut [f64]) -> f64 {
        // no heat: only where the muscle's pressure is known and states have rates
        for (i, mode) in self.modes.iter().enumerate() {
            let angular = TAU * mode.frequency_hz;
            let swing = x[2 * i + 1].abs() / (angular * 1.0e4);
            let resistance = 2.0 * (mode.damping + mode.turbulent * swing.powf(mode.power));
            let off_pa = now.pressure_pa - x[2 * i];
            dx[2 * i] = x[2 * i + 1];
            dx[2 * i + 1] = angular * (angular * off_pa - resistance * x[2 * i + 1]);
        }
        heat_w
    }
    fn read(&self, reading: &mut Reading, now: &Moment, x: &[f64]) {
        let modes = self.modes.iter().zip(x.chunks_exact(2));
        let off = modes.map(|(mode, x)| mode.share * (x[0] - now.pressure_pa));
        reading.pressure_pa += off.sum::<f64>();
    }
}

fn ringing(size: f64, rng: &mut Pcg64) -> Law {
    let frequency_hz = log_scale(size, 45.0, 5.0);
    let count = if rng.random_bool(0.35) { 2 } else { 1 };
    let parts = shares(rng, count);
    let mode = |(i, share): (usize, f64)| Mode {
        share,
        frequency_hz: frequency_hz * (1.0 + between(rng, 0.6, 2.0) * i as f64),
        damping: log_between(rng, 0.06, 0.5),
        turbulent: if rng.random_bool(0.5) {
            between(rng, 0.0, 0.5)
        } else {
            0.0
        },
        power: between(rng, 0.5, 1.2),
    };
    let modes: Vec<Mode> = parts.into_iter().enumerate().map(mode).collect();
    let words = format!("the reading rings from {frequency_hz:.1} Hz on");
    Law::new(Ringing { modes }, format!("ringing-{count}"), words)
}

/// Between isothermal and adiabatic.
const POLYTROPIC: f64 = 1.2;

/// A hose in cells of volume and resistance between the valve's port, where the sensor is, and
/// the muscle.
#[derive(Serialize)]
struct Hose {
    cells: usize,
    cell_m3: f64,
    conductance_kg_per_pa_s: f64,
    /// Flow over difference of pressure: 1 is laminar, one half turbulent above this difference.
    power: f64,
    corner_pa: f64,
    with_pressure: Curve,
    #[serde(skip)]
    high_pa: f64,
    #[serde(skip)]
    heat_j_per_kg: f64,
}

impl Hose {
    fn through(&self, from_pa: f64, to_pa: f64) -> f64 {
        let across_pa = from_pa - to_pa;
        let slowed = (1.0 + across_pa.abs() / self.corner_pa).powf(1.0 - self.power);
        let denser = self.with_pressure.at(from_pa.max(to_pa) / self.high_pa);
        self.conductance_kg_per_pa_s * denser * across_pa / slowed
    }
}

/// States: pressure of each cell from the valve on, gauge.
impl Hidden for Hose {
    fn commits(&self) -> bool {
        false
    }
    fn states(&self) -> usize {
        self.cells
    }
    fn settle(&self, now: &Moment, x: &mut [f64]) {
        x.fill(now.pressure_pa);
    }
    fn valve_side_pa(&self, _: f64, x: &[f64]) -> f64 {
        x[0]
    }
    fn flow_kg_per_s(&self, flow: f64, now: &Moment, x: &[f64], dx: &mut [f64]) -> f64 {
        let mut into = flow;
        for i in 0..self.cells {
            let next_pa = x.get(i + 1).copied().unwrap_or(now.pressure_pa);
            let out = self.through(x[i], next_pa);
            dx[i] = POLYTROPIC * self.heat_j_per_kg / self.cell_m3 * (into - out);
            into = out;
        }
        into
    }
    fn read(&self, reading: &mut Reading, now: &Moment, x: &[f64]) {
        reading.pressure_pa += x[0] - now.pressure_pa;
    }
}

fn hose(bench: &Bench, size: f64, rng: &mut Pcg64) -> Law {
    let lag_s = log_scale(size, 0.003, 0.03);
    let heat_j_per_kg = GAS_CONSTANT_J_PER_KG_K * bench.rig.ambient_temperature_k;
    let cells = rng.random_range(1..=3);
    let conductance_kg_per_pa_s = cells as f64 * bench.volume_m3 / (heat_j_per_kg * lag_s);
    // a cell that answers faster than half a millisecond is as good as none
    let fastest = conductance_kg_per_pa_s + bench.rig.flow_gain_kg_per_pa_s;
    let least_m3 = 0.5e-3 * POLYTROPIC * heat_j_per_kg * fastest;
    let cell_m3 = (bench.volume_m3 * between(rng, 0.03, 0.1)).max(least_m3);
    let effect = Hose {
        cells,
        cell_m3,
        conductance_kg_per_pa_s,
        power: between(rng, 0.5, 1.0),
        corner_pa: log_between(rng, 0.5e4, 1.0e5),
        with_pressure: Curve::draw(rng, 3.0),
        high_pa: bench.high_pa,
        heat_j_per_kg,
    };
    let words = format!(
        "the muscle lags the sensor at the valve's port by some {:.1} ms, through {cells} cells",
        1e3 * lag_s
    );
    Law::new(effect, format!("hose-{cells}"), words)
}

pub(super) fn dynamics(bench: &Bench, size: f64, rng: &mut Pcg64) -> Law {
    if rng.random_bool(0.5) {
        ringing(size, rng)
    } else {
        hose(bench, size, rng)
    }
}
