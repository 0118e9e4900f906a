//! Faults of the plant, and hardware that limits their effect, as terms of the plant.

use model_core::pressure::GaugePa;
use muscle_plant::nominal::Weight;
use muscle_plant::subsystem::Term;
use muscle_plant::subsystem::gas::{Exchange, GasPoint, GasTerm};
use muscle_plant::subsystem::load::{GRAVITY_M_PER_S2, LoadPoint, LoadTerm};
use muscle_plant::subsystem::supply::{SupplyPoint, SupplyTerm};
use muscle_plant::subsystem::term::Dynamics;
use muscle_plant::subsystem::valve::{ValvePoint, ValveTerm};

/// A valve that ignores its reference from `begins_s` on.
pub(super) struct BrokenValve {
    pub begins_s: f64,
    /// It controls the pressure to this share of the supply; below 0 it is shut.
    pub share: f64,
}

impl Dynamics<ValvePoint> for BrokenValve {}

impl ValveTerm for BrokenValve {
    fn reference(&self, at: &ValvePoint, _: &[f64], reference: GaugePa<f64>) -> GaugePa<f64> {
        if at.time_s >= self.begins_s && self.share >= 0.0 {
            GaugePa(self.share * at.supply.0)
        } else {
            reference
        }
    }

    fn flow_kg_per_s(&self, at: &ValvePoint, _: &[f64], flow_kg_per_s: f64) -> f64 {
        if at.time_s >= self.begins_s && self.share < 0.0 {
            0.0
        } else {
            flow_kg_per_s
        }
    }
}

/// A throttle between valve and muscle: its conductance is in series with that of the valve.
pub(super) struct Throttle {
    pub conductance_kg_per_pa_s: f64,
    pub valve_kg_per_pa_s: f64,
}

impl Dynamics<ValvePoint> for Throttle {}

impl ValveTerm for Throttle {
    fn flow_kg_per_s(&self, _: &ValvePoint, _: &[f64], flow_kg_per_s: f64) -> f64 {
        let (throttle, valve) = (self.conductance_kg_per_pa_s, self.valve_kg_per_pa_s);
        flow_kg_per_s * throttle / (throttle + valve)
    }
}

/// A check valve at the muscle's port that is shut from `begins_s` on.
pub(super) struct CheckValve {
    pub begins_s: f64,
}

impl Dynamics<ValvePoint> for CheckValve {}

impl ValveTerm for CheckValve {
    fn flow_kg_per_s(&self, at: &ValvePoint, _: &[f64], flow_kg_per_s: f64) -> f64 {
        if at.time_s >= self.begins_s {
            0.0
        } else {
            flow_kg_per_s
        }
    }
}

/// A leak from the muscle with laminar flow, between two times.
pub(super) struct Hole {
    pub from_s: f64,
    pub to_s: f64,
    pub conductance_kg_per_pa_s: f64,
}

impl Dynamics<GasPoint> for Hole {}

impl GasTerm for Hole {
    fn exchange(&self, at: &GasPoint, _: &[f64], exchange: &mut Exchange) {
        if at.time_s >= self.from_s && at.time_s < self.to_s {
            let gauge_pa = at.pressure.to_gauge(at.atmospheric).0.max(0.0);
            exchange.outflow_kg_per_s += self.conductance_kg_per_pa_s * gauge_pa;
        }
    }
}

/// A relief valve: above its opening pressure its flow is proportional to the excess pressure.
pub(super) struct Relief {
    pub opens_pa: f64,
    pub conductance_kg_per_pa_s: f64,
}

impl Dynamics<GasPoint> for Relief {}

impl GasTerm for Relief {
    fn exchange(&self, at: &GasPoint, _: &[f64], exchange: &mut Exchange) {
        let over_pa = at.pressure.to_gauge(at.atmospheric).0 - self.opens_pa;
        exchange.outflow_kg_per_s += self.conductance_kg_per_pa_s * over_pa.max(0.0);
    }
}

/// A supply whose pressure falls linearly to a share of it, within `within_s` from `begins_s`.
pub(super) struct FallingSupply {
    pub begins_s: f64,
    pub within_s: f64,
    pub share: f64,
}

impl Dynamics<SupplyPoint> for FallingSupply {}

impl SupplyTerm for FallingSupply {
    fn pressure(&self, at: &SupplyPoint, _: &[f64], supply: GaugePa<f64>) -> GaugePa<f64> {
        let done = ((at.time_s - self.begins_s) / self.within_s).clamp(0.0, 1.0);
        GaugePa(supply.0 * (1.0 - done * (1.0 - self.share)))
    }
}

/// A load whose mass is multiplied by `factor` from `begins_s` on.
pub(super) struct OtherLoad {
    pub begins_s: f64,
    pub factor: f64,
}

impl Dynamics<LoadPoint> for OtherLoad {}

impl LoadTerm for OtherLoad {
    fn change(&self, at: &LoadPoint, _: &[f64], weight: &mut Weight, _: &mut f64) {
        if at.time_s >= self.begins_s {
            weight.mass_kg *= self.factor;
        }
    }
}

/// A mechanical stop with a rubber buffer, which acts above the given contraction.
pub(super) struct UpperStop {
    pub contraction: f64,
    pub stiffness_n_per_m: f64,
    pub damping_ns_per_m: f64,
}

impl Dynamics<LoadPoint> for UpperStop {}

impl LoadTerm for UpperStop {
    fn change(&self, at: &LoadPoint, _: &[f64], _: &mut Weight, force_n: &mut f64) {
        let compression_m = (at.contraction - self.contraction) * at.initial_length_m;
        if compression_m > 0.0 {
            let speed_m_per_s = at.contraction_rate_per_s * at.initial_length_m;
            let push_n =
                self.stiffness_n_per_m * compression_m + self.damping_ns_per_m * speed_m_per_s;
            *force_n -= push_n.max(0.0);
        }
    }
}

/// A viscous damper parallel to the muscle.
pub(super) struct Damper {
    pub damping_ns_per_m: f64,
}

impl Dynamics<LoadPoint> for Damper {}

impl LoadTerm for Damper {
    fn change(&self, _: &LoadPoint, _: &[f64], weight: &mut Weight, _: &mut f64) {
        weight.viscous_damping_ns_per_m += self.damping_ns_per_m;
    }
}

/// Protective hardware, independent of the controller.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Hardware {
    /// None.
    None,
    /// A valve in the muscle's port that a spring shuts 10 ms after air, voltage or the pulses of
    /// the ticks are lost.
    CheckValve,
    /// A throttle in the hose, with the smallest flow gain that the assistance needs.
    Throttle,
    /// A mechanical stop with a buffer just above the stroke in use.
    MechanicalStop,
    /// A relief valve in the muscle's port, just above the pressure in use.
    ReliefValve,
    /// An oil damper parallel to the muscle.
    Damper,
}

impl Hardware {
    /// All hardware, without `None`.
    pub const ALL: [Hardware; 5] = [
        Hardware::CheckValve,
        Hardware::Throttle,
        Hardware::MechanicalStop,
        Hardware::ReliefValve,
        Hardware::Damper,
    ];

    /// Its terms of the plant, for a fault at `fault_s` that loses air or voltage or not, and a
    /// valve with this flow gain.
    pub(super) fn terms(self, fault_s: f64, loses_air: bool, valve_kg_per_pa_s: f64) -> Vec<Term> {
        match self {
            Hardware::None => vec![],
            Hardware::CheckValve if loses_air => vec![Term::Valve(Box::new(CheckValve {
                begins_s: fault_s + CHECK_VALVE_S,
            }))],
            Hardware::CheckValve => vec![],
            Hardware::Throttle => vec![Term::Valve(Box::new(Throttle {
                conductance_kg_per_pa_s: 3e-8,
                valve_kg_per_pa_s,
            }))],
            Hardware::MechanicalStop => vec![Term::Load(Box::new(UpperStop {
                contraction: 0.28,
                stiffness_n_per_m: 2e5,
                damping_ns_per_m: 2e3,
            }))],
            Hardware::ReliefValve => vec![Term::Gas(Box::new(Relief {
                opens_pa: 4.2e5,
                conductance_kg_per_pa_s: 1e-6,
            }))],
            // The weight of 12 kg falls at 0.25 m/s at most: c = M g / v.
            Hardware::Damper => vec![Term::Load(Box::new(Damper {
                damping_ns_per_m: 12.0 * GRAVITY_M_PER_S2 / 0.25,
            }))],
        }
    }
}

/// Time that a check valve takes to shut \[s\].
pub(super) const CHECK_VALVE_S: f64 = 0.01;
/// Time after the last edge of the pulses in which its coil is switched off, at most \[s\]: 4.7 V
/// at 150 kΩ and 100 nF fall to 1 V (docs/wiring.md).
pub(super) const PULSES_LAST_S: f64 = 0.0233;
