//! The nominal values of a rig: the constants of Eqs 1 to 5 and 9 as plain numbers in SI units.

use model_core::muscle::{Muscle, Volume};
use model_core::pressure::{AbsolutePa, GaugePa};

/// The weight of Eq 5.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Weight {
    /// M \[kg\].
    pub mass_kg: f64,
    /// C \[N·s/m\].
    pub viscous_damping_ns_per_m: f64,
    /// Coulomb friction while the weight moves \[N\].
    pub coulomb_friction_n: f64,
    /// Static friction: the force at which a weight at rest breaks away \[N\].
    pub static_friction_n: f64,
}

/// The load of the muscle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Load {
    /// A weight that hangs from the muscle, with a stop at contraction 0.
    Weight(Weight),
    /// A test bench that clamps or moves the muscle: the contraction is an input.
    Prescribed,
}

/// The servo valve and its supply.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Valve {
    /// K_G of Eq 9 \[kg/(Pa·s)\].
    pub flow_gain_kg_per_pa_s: f64,
    /// P_s.
    pub supply_pressure: GaugePa<f64>,
}

/// The air, its surroundings and the heat transfer through the muscle's wall.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Gas {
    /// θ_a \[K\].
    pub ambient_temperature_k: f64,
    /// P_a.
    pub atmospheric_pressure: AbsolutePa<f64>,
    /// h while air flows into the muscle \[W/(m²·K)\].
    pub heat_transfer_charging_w_per_m2_k: f64,
    /// h otherwise \[W/(m²·K)\].
    pub heat_transfer_discharging_w_per_m2_k: f64,
}

impl Gas {
    /// Air at 293 K and one standard atmosphere with the paper's heat transfer, for rigs that use
    /// only the pressure of the air.
    pub const STANDARD: Gas = Gas {
        ambient_temperature_k: 293.0,
        atmospheric_pressure: AbsolutePa(101_325.0),
        heat_transfer_charging_w_per_m2_k: 120.0,
        heat_transfer_discharging_w_per_m2_k: 80.0,
    };
}

/// The nominal values of one rig. A part that a simulation does not need may be absent.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Nominal {
    /// Eq 1.
    pub muscle: Muscle<f64>,
    /// Eq 2.
    pub volume: Option<Volume<f64>>,
    /// Eq 5.
    pub load: Load,
    /// Eq 9.
    pub valve: Option<Valve>,
    /// Eqs 3 and 4.
    pub gas: Option<Gas>,
}

impl Nominal {
    /// The paper's rig with valve B; constants that the paper does not give are chosen to reproduce
    /// its figures (docs/errata.md).
    pub const REFERENCE: Nominal = Nominal {
        muscle: Muscle {
            alpha_m2: 3.7718e-3,
            beta_m2: -1.39e-3,
            gamma_n: -183.0,
            initial_length_m: 0.3,
        },
        volume: Some(Volume {
            d1_m3: -9.90e-4,
            d2_m3: 7.005e-4,
            d3_m3: 2.30e-5,
        }),
        load: Load::Weight(Weight {
            mass_kg: 12.0,
            viscous_damping_ns_per_m: 45.0,
            coulomb_friction_n: 4.5,
            static_friction_n: 7.0,
        }),
        valve: Some(Valve {
            flow_gain_kg_per_pa_s: 1.3e-7,
            supply_pressure: GaugePa(5.0e5),
        }),
        gas: Some(Gas::STANDARD),
    };
}
