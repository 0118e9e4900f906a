//! The inputs of a simulation, and which part of the rig is simulated.

use crate::subsystem::load::Motion;
use model_core::pressure::GaugePa;

/// Which part of the rig is simulated; the rest is measured and comes in with the [`Drive`].
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

/// What comes from outside during a stretch of time without jumps.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Drive {
    /// Reference pressure that is sent to the valve, held.
    pub reference: GaugePa<f64>,
    /// Mean rate of the prescribed contraction to the next row \[1/s\]. The momentary one is the
    /// state's, set by [`simulation::Simulation::prescribe_contraction`].
    pub contraction_rate_per_s: f64,
    /// Rate of the momentary one \[1/s²\].
    pub contraction_acceleration_per_s2: f64,
    /// Rate of the prescribed pressure \[Pa/s\].
    pub pressure_rate_pa_per_s: f64,
    /// Measured supply pressure (gauge, \[Pa\]) in place of the rig's nominal one.
    pub supply: Option<Ramp>,
    /// A cock between valve and line is shut: nothing comes through the valve.
    pub shut: bool,
}

/// What holds between two events, in which the equations are smooth.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Regime {
    /// How the weight moves.
    pub motion: Motion,
    /// Air flows into the muscle (which sets the heat transfer).
    pub charging: bool,
}
