//! The bounds of docs/safety.md, derived from the rig and the settings.

use super::Case;
use super::kind::{Inject, LimitedBy};
use crate::rig::Rig;
use model_core::pressure::GaugePa;
use model_core::settings::SettingsValues;
use muscle_plant::nominal::Load;
use muscle_plant::subsystem::gas::HEAT_RATIO;
use muscle_plant::subsystem::load::GRAVITY_M_PER_S2;
use serde::Serialize;

/// The limits of the motion and pressure in a case.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Bounds {
    /// Highest permitted speed upwards after the fault \[m/s\].
    pub speed_up_m_per_s: f64,
    /// Highest permitted speed downwards after the fault \[m/s\].
    pub speed_down_m_per_s: f64,
    /// Highest permitted position of the weight above its stop \[m\].
    pub height_m: f64,
    /// Highest permitted pressure, gauge \[Pa\].
    pub pressure_pa: f64,
}

/// Ratio of the trip level of the weight's speed to the reference's speed limit.
const OVER_SPEED: f64 = model_core::limits::OVER_SPEED as f64;
/// Detection time of an excessive speed \[s\]: two ticks that are too fast, and the one before
/// them.
const DETECTION_S: f64 = 0.03;
/// Permitted ratio of a momentary pressure surge to the maximum allowable pressure, here that of
/// the supply: directive 2014/68/EU, annex I, 7.3.
const SURGE: f64 = 1.1;
/// Step of the integration of energy over travel \[m\].
const STEP_M: f64 = 1e-4;

/// Speed \[m/s\] and height \[m\] that the muscle at `pressure_pa` gives a load from rest on the
/// stop: ½Mv² = ∫(F(P, ε) − Mg)dy with F ≥ 0. Friction would make both smaller.
pub fn launch_speed_and_height(rig: &Rig, mass_kg: f64, pressure_pa: f64) -> (f64, f64) {
    let (mut energy_j, mut energy_j_max, mut height_m) = (0.0, 0.0_f64, 0.0);
    while energy_j >= 0.0 {
        let contraction = height_m / rig.nominal.muscle.initial_length_m;
        let force_n = if contraction < 1.0 {
            rig.nominal
                .muscle
                .force_n(contraction, GaugePa(pressure_pa))
                .max(0.0)
        } else {
            0.0
        };
        energy_j += (force_n - mass_kg * GRAVITY_M_PER_S2) * STEP_M;
        energy_j_max = energy_j_max.max(energy_j);
        height_m += STEP_M;
    }
    ((2.0 * energy_j_max / mass_kg).sqrt(), height_m)
}

/// Speed after a free fall \[m/s\].
pub fn free_fall_speed_m_per_s(height_m: f64) -> f64 {
    (2.0 * GRAVITY_M_PER_S2 * height_m).sqrt()
}

/// Gauge pressure \[Pa\] at which the muscle alone stops a load that falls from `height_m`: its
/// air, enclosed at `pressure_pa` when the rope becomes taut, is compressed adiabatically until it
/// has absorbed the energy of the weight.
pub fn catch_pressure_pa(rig: &Rig, mass_kg: f64, pressure_pa: f64, height_m: f64) -> f64 {
    let (Some(volume), Some(gas)) = (&rig.nominal.volume, &rig.nominal.gas) else {
        return pressure_pa;
    };
    let length_m = rig.nominal.muscle.initial_length_m;
    let atmospheric_pa = gas.atmospheric_pressure.0;
    let taut_contraction = (0..1000)
        .map(|step| f64::from(step) * 1e-3)
        .find(|contraction| {
            rig.nominal
                .muscle
                .force_n(*contraction, GaugePa(pressure_pa))
                <= 0.0
        })
        .unwrap_or(0.0);
    let taut_volume_m3 = volume.volume_m3(taut_contraction);
    let pressure_at = |contraction: f64| {
        let ratio = taut_volume_m3 / volume.volume_m3(contraction);
        (pressure_pa + atmospheric_pa) * ratio.powf(HEAT_RATIO) - atmospheric_pa
    };
    let weight_n = mass_kg * GRAVITY_M_PER_S2;
    let mut contraction = taut_contraction;
    let mut energy_j = weight_n * (height_m - taut_contraction * length_m).max(0.0);
    while energy_j >= 0.0 && contraction > 0.0 {
        let force_n = rig
            .nominal
            .muscle
            .force_n(contraction, GaugePa(pressure_at(contraction)));
        energy_j -= (force_n - weight_n) * STEP_M;
        contraction -= STEP_M / length_m;
    }
    pressure_at(contraction.max(0.0))
}

/// The bounds of `case` with a board of these settings.
pub fn bounds(case: &Case, values: &SettingsValues) -> Bounds {
    let rig = &case.rig;
    // The trip level, and free fall during the detection time.
    let trip_m_per_s = OVER_SPEED * f64::from(values.reference_speed_m_per_s_max);
    let controlled_m_per_s = trip_m_per_s + GRAVITY_M_PER_S2 * DETECTION_S;
    let stroke_m = f64::from(values.contraction_trip * values.muscle.initial_length_m);
    let mut bounds = Bounds {
        speed_up_m_per_s: controlled_m_per_s,
        speed_down_m_per_s: controlled_m_per_s,
        height_m: stroke_m,
        pressure_pa: SURGE * f64::from(values.supply_pressure_pa),
    };
    let LimitedBy::Physics { up, down } = case.kind.limited_by else {
        return bounds;
    };
    let mass_kg = match &rig.nominal.load {
        Load::Weight(weight) if case.kind.inject == Inject::Load => {
            weight.mass_kg * case.size.min(1.0)
        }
        Load::Weight(weight) => weight.mass_kg,
        Load::Prescribed => f64::from(values.load_kg),
    };
    if up {
        let supply_pa = f64::from(values.supply_pressure_pa);
        let (speed_m_per_s, height_m) = launch_speed_and_height(rig, mass_kg, supply_pa);
        bounds.speed_up_m_per_s = speed_m_per_s + controlled_m_per_s;
        bounds.height_m = height_m.max(stroke_m);
        let catch_pressure_pa = catch_pressure_pa(rig, mass_kg, supply_pa, bounds.height_m);
        bounds.pressure_pa = bounds.pressure_pa.max(catch_pressure_pa);
    }
    if down {
        bounds.speed_down_m_per_s =
            free_fall_speed_m_per_s(bounds.height_m).hypot(controlled_m_per_s);
    }
    bounds
}
