//! The plant in time: connections of the subsystems, inputs, and adaptive steps between located
//! events.

mod drive;
mod events;
mod integrate;
mod plant;
mod run;
mod trajectory;

pub use drive::{Drive, Ramp, Regime, Simulated};
pub use plant::{
    CONTRACTION, CONTRACTION_RATE, NOMINAL_STATES, PRESSURE, Plant, PlantError, Pneumatics,
    STATES_MAX, TEMPERATURE,
};
pub use run::Simulation;
pub use trajectory::{Initial, SimulationError, TOLERANCE, Work};
