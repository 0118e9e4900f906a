//! The inputs of a simulation, and the part of the rig that is simulated.

use crate::subsystem::load::Motion;
use model_core::pressure::GaugePa;

/// The part of the rig that is simulated; the rest is measured and comes with the [`Drive`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Simulated {
    /// Valve, line and gas (else the pressure is an input).
    pub pressure: bool,
    /// The load (else the contraction is an input).
    pub motion: bool,
}

impl Simulated {
    /// Everything.
    pub const WHOLE: Simulated = Simulated {
        pressure: true,
        motion: true,
    };
    /// Valve, line and gas; the contraction is an input.
    pub const GAS_ONLY: Simulated = Simulated {
        pressure: true,
        motion: false,
    };
    /// The load; the pressure is an input.
    pub const LOAD_ONLY: Simulated = Simulated {
        pressure: false,
        motion: true,
    };
    /// Muscle and instruments; pressure and contraction are inputs.
    pub const FORCE_ONLY: Simulated = Simulated {
        pressure: false,
        motion: false,
    };
}

/// A quantity that changes linearly.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ramp {
    /// When it has `value` \[s\].
    pub start_s: f64,
    /// Its value at `start_s`.
    pub value: f64,
    /// Its rate \[1/s\].
    pub rate_per_s: f64,
}

/// Inputs during an interval without jumps.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Drive {
    /// Reference pressure that is sent to the valve, constant.
    pub reference: GaugePa<f64>,
    /// Mean rate of the prescribed contraction to the next row \[1/s\]. The momentary rate is in
    /// the state, set by
    /// [`Simulation::prescribe_contraction`](super::Simulation::prescribe_contraction).
    pub contraction_rate_per_s: f64,
    /// Rate of the momentary rate \[1/s²\].
    pub contraction_acceleration_per_s2: f64,
    /// Rate of the prescribed pressure \[Pa/s\].
    pub pressure_rate_pa_per_s: f64,
    /// Measured supply pressure (gauge, \[Pa\]) instead of the nominal one.
    pub supply: Option<Ramp>,
    /// A shut-off valve between valve and line is shut: no flow through the valve.
    pub shut: bool,
}

/// Conditions between two events, in which the equations are smooth.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Regime {
    /// Motion of the weight.
    pub motion: Motion,
    /// Air flows into the muscle (which determines the heat transfer).
    pub charging: bool,
}
