//! The subsystems of the plant: each is its nominal equation and a list of terms that change it.
//!
//! A term is what an effect adds to one subsystem; the trait of each subsystem's terms stands in the
//! subsystem's file.

pub mod gas;
pub mod line;
pub mod load;
pub mod muscle;
pub mod sensors;
pub mod supply;
pub mod term;
pub mod valve;

use gas::GasTerm;
use line::LineTerm;
use load::LoadTerm;
use muscle::MuscleTerm;
use sensors::SensorTerm;
use supply::SupplyTerm;
use valve::ValveTerm;

/// A term with the subsystem that it belongs to.
pub enum Term {
    /// On the muscle's force.
    Muscle(Box<dyn MuscleTerm>),
    /// On the weight.
    Load(Box<dyn LoadTerm>),
    /// On the valve.
    Valve(Box<dyn ValveTerm>),
    /// On the hose or the command line.
    Line(Box<dyn LineTerm>),
    /// On the air in the muscle.
    Gas(Box<dyn GasTerm>),
    /// On the supply.
    Supply(Box<dyn SupplyTerm>),
    /// On the instruments.
    Sensor(Box<dyn SensorTerm>),
}
