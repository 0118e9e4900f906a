//! The gas: mass and energy of the air in the muscle (Eqs 3 and 4).

use super::term::{Dynamics, Terms};
use crate::nominal::Gas;
use model_core::muscle::Volume;
use model_core::pressure::AbsolutePa;

/// Specific gas constant of air R \[J/(kg·K)\].
pub const GAS_CONSTANT_J_PER_KG_K: f64 = 287.0;
/// Specific heat of air at constant volume C_v \[J/(kg·K)\].
pub const HEAT_CONSTANT_VOLUME_J_PER_KG_K: f64 = 718.0;
/// Specific heat of air at constant pressure C_p = C_v + R \[J/(kg·K)\].
pub const HEAT_CONSTANT_PRESSURE_J_PER_KG_K: f64 =
    HEAT_CONSTANT_VOLUME_J_PER_KG_K + GAS_CONSTANT_J_PER_KG_K;
/// Ratio of specific heats κ = C_p/C_v \[-\].
pub const HEAT_RATIO: f64 = HEAT_CONSTANT_PRESSURE_J_PER_KG_K / HEAT_CONSTANT_VOLUME_J_PER_KG_K;

const R: f64 = GAS_CONSTANT_J_PER_KG_K;
const CV: f64 = HEAT_CONSTANT_VOLUME_J_PER_KG_K;
const CP: f64 = HEAT_CONSTANT_PRESSURE_J_PER_KG_K;

/// The inputs of a gas term.
#[derive(Clone, Copy, Debug)]
pub struct GasPoint {
    /// Time \[s\].
    pub time_s: f64,
    /// Pressure in the muscle.
    pub pressure: AbsolutePa<f64>,
    /// Pressure of the surrounding air.
    pub atmospheric: AbsolutePa<f64>,
    /// Gas temperature \[K\].
    pub temperature_k: f64,
    /// Nominal heat transfer coefficient h of the present regime \[W/(m²·K)\]. It jumps with the
    /// sign of the flow, so that the integration changes it between steps only.
    pub heat_transfer_w_per_m2_k: f64,
    /// Ambient temperature \[K\].
    pub ambient_temperature_k: f64,
}

/// Exchange of mass and heat through the muscle's port and wall.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Exchange {
    /// Mass flow in, at ambient temperature \[kg/s\], ≥ 0.
    pub inflow_kg_per_s: f64,
    /// Mass flow out, at the temperature of the gas \[kg/s\], ≥ 0.
    pub outflow_kg_per_s: f64,
    /// Heat transfer coefficient h \[W/(m²·K)\].
    pub heat_transfer_w_per_m2_k: f64,
    /// Temperature of the wall \[K\]; ambient in the nominal muscle.
    pub wall_temperature_k: f64,
}

/// A term of the gas: changes the exchange (a leak, a wall that stores heat).
pub trait GasTerm: Dynamics<GasPoint> + Send + Sync {
    /// Changes `exchange`.
    fn exchange(&self, point: &GasPoint, state: &[f64], exchange: &mut Exchange);
}

/// The air in the muscle.
pub struct GasSubsystem {
    /// Surroundings and heat transfer.
    pub gas: Gas,
    /// Eq 2.
    pub volume: Volume<f64>,
    /// L \[m\], for the area of the wall.
    pub initial_length_m: f64,
    /// Added effects.
    pub terms: Terms<dyn GasTerm>,
}

impl GasSubsystem {
    /// Mass of the gas W = PV/(Rθ) \[kg\].
    pub fn mass_kg(&self, contraction: f64, pressure: AbsolutePa<f64>, temperature_k: f64) -> f64 {
        pressure.0 * self.volume.volume_m3(contraction) / (R * temperature_k)
    }

    /// Area of heat exchange S_h \[m²\]: the lateral area of a cylinder with the muscle's volume
    /// and length L(1−ε), S_h = 2√(πV·L(1−ε)).
    #[inline]
    pub fn wall_area_m2(&self, contraction: f64, volume_m3: f64) -> f64 {
        let length_m = self.initial_length_m * (1.0 - contraction);
        2.0 * (core::f64::consts::PI * volume_m3 * length_m).sqrt()
    }

    /// Nominal heat transfer coefficient \[W/(m²·K)\].
    #[inline]
    pub fn heat_transfer_w_per_m2_k(&self, charging: bool) -> f64 {
        if charging {
            self.gas.heat_transfer_charging_w_per_m2_k
        } else {
            self.gas.heat_transfer_discharging_w_per_m2_k
        }
    }

    /// Exchange with all terms at a mass flow `flow_kg_per_s` from the line into the muscle (out of
    /// it if negative).
    #[inline]
    pub fn exchange(&self, point: &GasPoint, flow_kg_per_s: f64, state: &[f64]) -> Exchange {
        let mut exchange = Exchange {
            inflow_kg_per_s: flow_kg_per_s.max(0.0),
            outflow_kg_per_s: (-flow_kg_per_s).max(0.0),
            heat_transfer_w_per_m2_k: point.heat_transfer_w_per_m2_k,
            wall_temperature_k: self.gas.ambient_temperature_k,
        };
        if !self.terms.is_empty() {
            exchange = self.with_terms(*point, state, exchange);
        }
        exchange
    }

    #[inline(never)]
    fn with_terms(&self, point: GasPoint, state: &[f64], mut exchange: Exchange) -> Exchange {
        for (term, state) in self.terms.iter(state) {
            term.exchange(&point, state, &mut exchange);
        }
        exchange
    }

    /// Rates of absolute pressure \[Pa/s\] and temperature \[K/s\], Eqs 3 and 4 solved for them.
    ///
    /// Eq 4 (energy, with the signs of the errata) reads d(C_v W θ)/dt = C_p(G_in θ_a − G_out θ)
    /// − P V̇ + h S_h(θ_w − θ), with the wall at θ_w = θ_a unless a term warms it. With W = PV/(Rθ)
    /// its left side is (C_v/R)(V Ṗ + P V̇), which gives Ṗ; then P V̇ + V Ṗ = G R θ + W R θ̇ (Eq 3)
    /// gives θ̇. Valid for V > 0, P > 0, θ > 0.
    #[inline]
    pub fn rates(
        &self,
        point: &GasPoint,
        contraction: f64,
        contraction_rate_per_s: f64,
        exchange: &Exchange,
    ) -> (f64, f64) {
        let (pressure_pa, temperature_k) = (point.pressure.0, point.temperature_k);
        let ambient_k = self.gas.ambient_temperature_k;
        let volume_m3 = self.volume.volume_m3(contraction);
        let volume_rate_m3_per_s = self.volume.slope_m3(contraction) * contraction_rate_per_s;
        let area_m2 = self.wall_area_m2(contraction, volume_m3);

        let enthalpy_w =
            CP * (exchange.inflow_kg_per_s * ambient_k - exchange.outflow_kg_per_s * temperature_k);
        let heat_w = exchange.heat_transfer_w_per_m2_k
            * area_m2
            * (exchange.wall_temperature_k - temperature_k);
        let work_w = pressure_pa * volume_rate_m3_per_s;
        // V Ṗ and P V̇ are powers, so that one division suffices for both rates.
        let charging_w = (R / CV) * (enthalpy_w - work_w + heat_w) - work_w;
        let net_flow_kg_per_s = exchange.inflow_kg_per_s - exchange.outflow_kg_per_s;
        let per_energy = 1.0 / (pressure_pa * volume_m3);
        let pressure_rate_pa_per_s = charging_w * per_energy * pressure_pa;
        let temperature_rate_k_per_s = temperature_k
            * per_energy
            * (work_w + charging_w - net_flow_kg_per_s * R * temperature_k);
        (pressure_rate_pa_per_s, temperature_rate_k_per_s)
    }
}
