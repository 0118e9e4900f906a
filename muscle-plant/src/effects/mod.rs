//! Effects that can be added to the plant, one file each.
//!
//! An effect is a property of a rig that the nominal model leaves out. Its file declares all of it:
//! name, subsystem, the equations that it changes, its signature in data, how the controller
//! compensates it, and one or more forms. A form is a set of equations that has been used for it: a
//! term of the plant with few parameters. A new effect is one file here and one line in `effects!`;
//! a new form is one entry in the effect's file. A program can add its own effects to the catalogue
//! with [`Catalogue::with`].
//!
//! A measured rig follows none of the forms exactly: each states its source and what it leaves out.

mod catalogue;
mod compensation;
mod kind;
mod observation;
pub mod orifice;

pub use catalogue::Catalogue;
pub use compensation::{AddedFriction, CompensationMethod, DeadZoneWidths};
pub use kind::{
    Build, DISCREPANCY_RATIO, Effect, EffectKind, Equation, Form, Observe, Parameter, Quantity,
    Requirement,
};
pub use observation::{DecayingForce, Observation};

use crate::nominal::Gas;

/// Declares the file of each effect and lists it in the catalogue, in this order.
macro_rules! effects {
    ($($effect:ident)*) => {
        $(pub mod $effect;)*
        const STANDARD: &[&EffectKind] = &[$(&$effect::KIND),*];
    };
}

effects! {
    hysteresis
    creep
    dead_band
    bladder_elasticity
    slack
    run_in
    friction
    payload
    backlash
    valve_dead_zone
    flow_limit
    valve_lag
    transport_delay
    line_dynamics
    leak
    heat_exchange
    supply_droop
    pressure_sensor_offset
    pressure_sensor_gain
    pressure_sensor_drift
    contraction_sensor_offset
    force_sensor_offset
}

/// Pressure at which a force that grows with pressure has the size of its parameter \[Pa\].
const REFERENCE_PRESSURE_PA: f64 = 3e5;
/// Contraction at which a force that grows with it has the size of its parameter \[-\].
const REFERENCE_CONTRACTION: f64 = 0.25;
/// Unit of pressures in states \[Pa\].
const STATE_PA: f64 = 1e5;
/// Temperature of the air outside the muscle \[K\].
const AIR_TEMPERATURE_K: f64 = Gas::STANDARD.ambient_temperature_k;
/// Lags below this are neglected \[s\].
const INSTANT_S: f64 = 2e-5;

/// State of a first-order lag after `length_s` \[s\] in which its drive changed linearly from one
/// value to another.
fn lagged(state: f64, [from, to]: [f64; 2], length_s: f64, time_constant_s: f64) -> f64 {
    if length_s <= 0.0 {
        return state;
    }
    let steady_lag = (to - from) * time_constant_s / length_s;
    state + (to - from) + (state - from + steady_lag) * (-length_s / time_constant_s).exp_m1()
}

#[cfg(test)]
mod testing;
#[cfg(test)]
mod tests;
