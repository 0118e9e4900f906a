//! Muscle rigs with hidden effects, to measure how well a diagnosis names them.
//!
//! Everything here is its own: the plant's equations, the integrator and the forms of the effects
//! share nothing with the program that is measured, so that agreement between them is evidence.
//! A case is reproduced by its seed and number alone.

mod case;
mod drive;
mod effects;
mod hidden;
mod machine;
mod record;
mod rig;
#[cfg(test)]
mod tests;

pub use case::{Case, Kind, Plan, Planned, case, plan};
pub use effects::{CATALOGUE, Entry, Form};
pub use record::{Sensor, Sensors};
pub use rig::Rig;
