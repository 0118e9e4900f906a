//! A drawn rig: muscle, load, valve, sensors and clock that fit each other.

use rand::RngExt;
use rand_pcg::Pcg64;

use super::shape::{between, log_between};
use crate::machine::{GAS_CONSTANT_J_PER_KG_K, GRAVITY_M_PER_S2};
use crate::record::{Sensor, Sensors};
use crate::rig::{Pair, Rig, rounded};

/// Least and greatest flow gain of a valve, a factor of 30.
const FLOW_GAIN_KG_PER_PA_S: [f64; 2] = [6.0e-9, 1.8e-7];
/// Least and greatest time constant of valve and gas at mid contraction: the paper's valve A has
/// 0.2 s and its valve B 0.01 s.
const GAS_S: [f64; 2] = [2.5e-3, 0.4];
/// Share of the contraction at which Eq 1 has no force left that drives keep below.
const CONTRACTION_SHARE: f64 = 0.72;
/// Most rows of a record: 1 kHz for half a minute, or 100 Hz for five minutes.
const ROWS: f64 = 30_000.0;

/// A rig without effects, and what it is used for.
#[derive(Clone, Debug)]
pub(crate) struct Bench {
    pub(crate) rig: Rig,
    /// Pressure at which the weight leaves its stop.
    pub(crate) lift_pa: f64,
    /// Pressure at the largest contraction that drives use.
    pub(crate) high_pa: f64,
    /// Contraction at which Eq 1 has no force left at any pressure.
    pub(crate) contraction_most: f64,
    /// Eq 1's slope ∂F/∂P at rest length times the middle pressure: the force of a held muscle.
    pub(crate) blocked_n: f64,
    /// Volume half way up.
    pub(crate) volume_m3: f64,
}

impl Bench {
    pub(crate) fn of(rig: Rig) -> Self {
        let weight_n = rig.mass_kg * GRAVITY_M_PER_S2;
        let contraction_most = 1.0 - (-rig.beta_m2 / rig.alpha_m2).sqrt();
        let reached = CONTRACTION_SHARE * contraction_most;
        let area_m2 = |contraction: f64| rig.alpha_m2 * (1.0 - contraction).powi(2) + rig.beta_m2;
        let lift_pa = (weight_n - rig.gamma_n) / area_m2(0.0);
        let balance_pa = (weight_n - rig.gamma_n) / area_m2(reached);
        let high_pa = balance_pa.min(0.97 * rig.supply_pressure_pa);
        let half = 0.5 * reached;
        let volume_m3 = rig.volume_d1_m3 * half * half + rig.volume_d2_m3 * half + rig.volume_d3_m3;
        Self {
            lift_pa,
            high_pa,
            contraction_most,
            blocked_n: area_m2(0.0) * 0.5 * (lift_pa + high_pa),
            volume_m3,
            rig,
        }
    }

    pub(crate) fn weight_n(&self) -> f64 {
        self.rig.mass_kg * GRAVITY_M_PER_S2
    }

    /// Pressure in the middle of those at which the weight hangs free.
    pub(crate) fn middle_pa(&self) -> f64 {
        0.5 * (self.lift_pa + self.high_pa)
    }

    /// Time constant of valve and gas at constant volume.
    pub(crate) fn gas_s(&self) -> f64 {
        let heat_j_per_kg = GAS_CONSTANT_J_PER_KG_K * self.rig.ambient_temperature_k;
        self.volume_m3 / (heat_j_per_kg * self.rig.flow_gain_kg_per_pa_s)
    }

    /// Stiffness −∂F/∂ε half way up.
    pub(crate) fn stiffness_n(&self) -> f64 {
        let half = 0.5 * CONTRACTION_SHARE * self.contraction_most;
        2.0 * self.rig.alpha_m2 * (1.0 - half) * self.middle_pa()
    }

    /// Angular frequency at which the weight swings half way up.
    pub(crate) fn angular_per_s(&self) -> f64 {
        (self.stiffness_n() / (self.rig.mass_kg * self.rig.initial_length_m)).sqrt()
    }
}

/// A braided muscle by Chou and Hannaford, of `diameter_m` and with the braid's angle at rest.
fn muscle(rng: &mut Pcg64) -> Rig {
    let diameter_m = log_between(rng, 0.010, 0.040);
    let angle = between(rng, 17.0, 24.0).to_radians();
    let length_m = rounded(log_between(rng, 0.15, 0.6), 3);
    let section_m2 = 0.25 * std::f64::consts::PI * diameter_m * diameter_m;
    let alpha_m2 = 3.0 * section_m2 / angle.tan().powi(2);
    let beta_m2 = -section_m2 / angle.sin().powi(2);
    let threshold_pa = between(rng, 30.0e3, 90.0e3);
    // the paper's quadratic, next to what the force law's virtual work gives
    let volume_d2_m3 = between(rng, 0.96, 1.0) * length_m * (alpha_m2 + beta_m2);
    let volume_d1_m3 = -between(rng, 0.84, 0.91) * length_m * alpha_m2;
    let volume_d3_m3 = between(rng, 0.55, 1.0) * length_m * section_m2;
    Rig {
        alpha_m2: rounded(alpha_m2, 4),
        beta_m2: rounded(beta_m2, 4),
        gamma_n: rounded(-threshold_pa * (alpha_m2 + beta_m2), 4),
        volume_d1_m3: rounded(volume_d1_m3, 4),
        volume_d2_m3: rounded(volume_d2_m3, 4),
        volume_d3_m3: rounded(volume_d3_m3, 4),
        initial_length_m: length_m,
        ..Rig::default()
    }
}

/// A rig whose muscle lifts its load over most of its stroke within the supply's pressure.
///
/// With `near_supply` the supply is just what the drives ask for.
fn nominal(near_supply: bool, rng: &mut Pcg64) -> Rig {
    loop {
        let mut rig = muscle(rng);
        rig.mass_kg = rounded(log_between(rng, 3.0, 50.0), 3);
        rig.flow_gain_kg_per_pa_s = rounded(
            log_between(rng, FLOW_GAIN_KG_PER_PA_S[0], FLOW_GAIN_KG_PER_PA_S[1]),
            3,
        );
        rig.ambient_temperature_k = rounded(between(rng, 288.0, 299.0), 4);
        rig.supply_pressure_pa = f64::INFINITY;
        let bench = Bench::of(rig.clone());
        let margin = if near_supply {
            1.031
        } else {
            between(rng, 1.04, 1.4)
        };
        rig.supply_pressure_pa = rounded((margin * bench.high_pa).clamp(2.5e5, 8.0e5), 3);
        let bench = Bench::of(rig.clone());
        let lifts = bench.lift_pa < 0.5 * bench.high_pa;
        let flows = (GAS_S[0]..GAS_S[1]).contains(&bench.gas_s());
        // a supply that a droop would never let run short hides it
        let near = !near_supply || bench.high_pa > 0.9 * rig.supply_pressure_pa;
        if !(lifts && flows && near) {
            continue;
        }
        let coulomb_n = bench.weight_n() * between(rng, 0.01, 0.05);
        rig.coulomb_friction_n = rounded(coulomb_n, 3);
        rig.static_friction_n = rounded(coulomb_n * between(rng, 1.1, 1.8), 3);
        let damping = 2.0 * between(rng, 0.05, 0.2) * rig.mass_kg * bench.angular_per_s();
        rig.viscous_damping_ns_per_m = rounded(damping, 3);
        rig.heat_transfer_charging_w_per_m2_k = rounded(between(rng, 90.0, 150.0), 2);
        rig.heat_transfer_discharging_w_per_m2_k = rounded(between(rng, 60.0, 100.0), 2);
        return rig;
    }
}

/// Nominal and true rig.
pub(crate) fn pair(near_supply: bool, rng: &mut Pcg64) -> Pair {
    let nominal = nominal(near_supply, rng);
    Pair::around(nominal, rng)
}

/// The reference sensors with a quarter to six times their noise.
pub(crate) fn sensors(rig: &Rig, rng: &mut Pcg64) -> Sensors {
    let all = log_between(rng, 0.25 / 0.8, 6.0 * 0.8);
    let usual = Sensors::default();
    let mut of = |sensor: Sensor, unit: f64| {
        let factor = unit * all * log_between(rng, 0.8, 1.25);
        Sensor {
            sigma: factor * sensor.sigma,
            step: factor * sensor.step,
        }
    };
    // the encoder's noise is a length
    let relative = Rig::default().initial_length_m / rig.initial_length_m;
    Sensors {
        pressure_pa: of(usual.pressure_pa, 1.0),
        contraction: of(usual.contraction, relative),
        force_n: of(usual.force_n, 1.0),
    }
}

/// Sampling times of a case's records.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Clock {
    pub(crate) rate_hz: f64,
    pub(crate) duration_s: f64,
    /// Each row is off its regular time by up to this share of the period.
    pub(crate) jitter: f64,
}

impl Clock {
    pub(crate) fn draw(rng: &mut Pcg64) -> Self {
        const USUAL_HZ: [f64; 9] = [20.0, 25.0, 50.0, 100.0, 125.0, 200.0, 250.0, 500.0, 1000.0];
        let rate_hz = if rng.random_bool(0.7) {
            USUAL_HZ[rng.random_range(0..USUAL_HZ.len())]
        } else {
            log_between(rng, 20.0, 1000.0).round()
        };
        let duration_s = log_between(rng, 20.0, 300.0).min(ROWS / rate_hz);
        let jitter = if rng.random_bool(0.15) {
            between(rng, 0.05, 0.35)
        } else {
            0.0
        };
        Self {
            rate_hz,
            duration_s,
            jitter,
        }
    }

    /// Rows of a record.
    pub(crate) fn rows(&self) -> usize {
        (self.duration_s * self.rate_hz).round() as usize + 1
    }

    /// Times of rows from `-unrecorded_s` on, to the microsecond; one is zero.
    pub(crate) fn times_s(&self, unrecorded_s: f64, rng: &mut Pcg64) -> (Vec<f64>, usize) {
        let unrecorded = (unrecorded_s * self.rate_hz).round() as usize;
        let rows = self.rows();
        let time_s = |i: usize| {
            let late = if self.jitter > 0.0 && i != unrecorded {
                self.jitter * rng.random_range(-1.0..1.0)
            } else {
                0.0
            };
            let periods = i as f64 - unrecorded as f64 + late;
            (periods / self.rate_hz * 1.0e6).round() / 1.0e6
        };
        ((0..unrecorded + rows).map(time_s).collect(), unrecorded)
    }
}
