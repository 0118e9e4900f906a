//! From data sheets to a rig, and back: a muscle's table of forces, a valve's flow rates.

mod fit;
pub mod muscle;
pub mod report;
pub mod rig;
mod table;
pub mod valve;
pub mod volume;
