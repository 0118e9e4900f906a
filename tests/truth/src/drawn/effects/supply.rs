//! Supply: a reservoir behind a restriction.

use rand::RngExt;
use rand_pcg::Pcg64;
use serde::Serialize;

use super::super::bench::Bench;
use super::super::shape::{Ramp, between, log_between, log_scale};
use super::Law;
use crate::hidden::{Hidden, Moment};
use crate::machine::GAS_CONSTANT_J_PER_KG_K;

/// State: pressure of the reservoir, gauge.
#[derive(Serialize)]
struct Droop {
    reservoir_m3: f64,
    /// Of the gas that stays.
    polytropic: f64,
    /// Time in which 100 kPa are made up for at the first rate.
    recovery_s: f64,
    /// Refill over what is missing.
    refill: Ramp,
    /// A check valve keeps gas in the muscle.
    check_valve: bool,
    supply_pa: f64,
    #[serde(skip)]
    heat_j_per_kg: f64,
}

impl Hidden for Droop {
    fn commits(&self) -> bool {
        false
    }
    fn states(&self) -> usize {
        1
    }
    fn settle(&self, _: &Moment, x: &mut [f64]) {
        x[0] = self.supply_pa;
    }
    fn reference_pa(&self, reference_pa: f64, _: &Moment, x: &[f64], _: &mut [f64]) -> f64 {
        reference_pa.min(x[0])
    }
    fn flow_kg_per_s(&self, flow: f64, now: &Moment, x: &[f64], dx: &mut [f64]) -> f64 {
        let open_to_supply = now.reference_pa >= x[0];
        let passed = if open_to_supply && self.check_valve {
            flow.max(0.0)
        } else {
            flow
        };
        let taken = if open_to_supply {
            passed
        } else {
            flow.max(0.0)
        };
        let missing = (self.supply_pa - x[0]) / 1.0e5;
        let refill_pa_per_s = 1.0e5 / self.recovery_s * self.refill.at(missing);
        let use_pa_per_kg = self.polytropic * self.heat_j_per_kg / self.reservoir_m3;
        dx[0] = refill_pa_per_s - use_pa_per_kg * taken;
        passed
    }
}

pub(super) fn droop(bench: &Bench, size: f64, rng: &mut Pcg64) -> Law {
    // a fill of the muscle takes so much out of the reservoir
    let fall_pa = log_scale(size, 12.0e3, 150.0e3);
    let recovery_s = log_between(rng, 0.4, 3.0);
    let reservoir_m3 = bench.volume_m3 * bench.high_pa / fall_pa;
    let words = format!(
        "a reservoir of {:.2} L, from which a fill takes {:.0} kPa, recovering in \
         {recovery_s:.2} s",
        1e3 * reservoir_m3,
        1e-3 * fall_pa
    );
    Law::new(
        Droop {
            reservoir_m3,
            polytropic: between(rng, 1.0, 1.4),
            recovery_s,
            refill: Ramp::draw(rng, 4.0),
            check_valve: rng.random_bool(0.6),
            supply_pa: bench.rig.supply_pressure_pa,
            heat_j_per_kg: GAS_CONSTANT_J_PER_KG_K * bench.rig.ambient_temperature_k,
        },
        "reservoir",
        words,
    )
}
