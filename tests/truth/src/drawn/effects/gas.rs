//! The gas: leaks, and heat exchanged with more than the paper's wall.

use rand::RngExt;
use rand_pcg::Pcg64;
use serde::Serialize;

use super::super::bench::Bench;
use super::super::shape::{Coordinate, Modulation, between, log_between, log_scale};
use super::Law;
use crate::hidden::{Hidden, Moment};

/// Gas that leaves the muscle past the valve.
#[derive(Serialize)]
struct Leak {
    /// Over gauge pressure, at the middle pressure.
    conductance_kg_per_pa_s: f64,
    middle_pa: f64,
    /// Of the flow in gauge pressure.
    power: f64,
    modulation: Modulation,
}

impl Hidden for Leak {
    fn commits(&self) -> bool {
        false
    }
    fn leak_kg_per_s(&self, now: &Moment) -> f64 {
        // its lips close: nothing is drawn in
        let u = (now.pressure_pa / self.middle_pa).max(0.0);
        let flow = self.conductance_kg_per_pa_s * self.middle_pa * u.powf(self.power);
        flow * self.modulation.at(now)
    }
}

pub(super) fn leak(bench: &Bench, size: f64, rng: &mut Pcg64) -> Law {
    // against the valve's gain, which decides how far the pressure stays short
    let conductance_kg_per_pa_s = bench.rig.flow_gain_kg_per_pa_s * log_scale(size, 2.0e-3, 8.0e-2);
    let power = between(rng, 0.8, 1.6);
    let coordinates = [Coordinate::Pressure, Coordinate::Contraction];
    let modulation = Modulation::draw(rng, &coordinates, bench);
    let words = format!(
        "{conductance_kg_per_pa_s:.2e} kg/(Pa s) at the middle pressure, with its power \
         {power:.2}{}",
        modulation.words()
    );
    Law::new(
        Leak {
            conductance_kg_per_pa_s,
            middle_pa: bench.middle_pa(),
            power,
            modulation,
        },
        "power",
        words,
    )
}

/// Heat transfer of the nominal rig times a factor that may depend on the flow.
#[derive(Serialize)]
struct ScaledHeat {
    factor: f64,
    modulation: Modulation,
}

impl Hidden for ScaledHeat {
    fn commits(&self) -> bool {
        false
    }
    fn heat_w(&self, heat_w: f64, now: &Moment, _: &[f64], _: &mut [f64]) -> f64 {
        self.factor * self.modulation.at(now) * heat_w
    }
}

/// Layers of bladder and braid as stores of heat between gas and room.
#[derive(Serialize)]
struct Walls {
    /// From the gas to the first layer, and on from each layer.
    transfer_w_per_m2_k: Vec<f64>,
    capacity_j_per_k: Vec<f64>,
    modulation: Modulation,
}

/// States: temperature of each layer over the room's.
impl Hidden for Walls {
    fn commits(&self) -> bool {
        false
    }
    fn states(&self) -> usize {
        self.capacity_j_per_k.len()
    }
    fn settle(&self, _: &Moment, x: &mut [f64]) {
        x.fill(0.0);
    }
    fn heat_w(&self, _: f64, now: &Moment, x: &[f64], dx: &mut [f64]) -> f64 {
        let transfer = |i: usize| self.transfer_w_per_m2_k[i] * now.surface_m2;
        let gas_k = now.temperature_k - now.ambient_k;
        let from_gas_w = self.modulation.at(now) * transfer(0) * (gas_k - x[0]);
        let mut into_w = from_gas_w;
        for i in 0..x.len() {
            let next_k = x.get(i + 1).copied().unwrap_or(0.0);
            let out_w = transfer(i + 1) * (x[i] - next_k);
            dx[i] = (into_w - out_w) / self.capacity_j_per_k[i];
            into_w = out_w;
        }
        -from_gas_w
    }
}

pub(super) fn heat_exchange(bench: &Bench, size: f64, rng: &mut Pcg64) -> Law {
    let factor = log_scale(size, 3.0, 60.0);
    let coordinates = [Coordinate::Flow, Coordinate::Pressure];
    let modulation = Modulation::draw(rng, &coordinates, bench);
    let words = format!(
        "{factor:.1} times the nominal transfer{}",
        modulation.words()
    );
    if rng.random_bool(0.5) {
        return Law::new(ScaledHeat { factor, modulation }, "scaled", words);
    }
    let layers = rng.random_range(1..=3);
    // what the gas itself stores, as heat
    let gas_j_per_k = 3.0 * bench.middle_pa() * bench.volume_m3 / 293.0;
    let mut transfer_w_per_m2_k = vec![100.0 * factor];
    transfer_w_per_m2_k.extend((0..layers).map(|_| log_between(rng, 10.0, 100.0)));
    let capacity = |_| gas_j_per_k * log_between(rng, 5.0, 80.0);
    let capacity_j_per_k = (0..layers).map(capacity).collect();
    Law::new(
        Walls {
            transfer_w_per_m2_k,
            capacity_j_per_k,
            modulation,
        },
        format!("walls-{layers}"),
        words,
    )
}
