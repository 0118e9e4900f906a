//! The subsystems of the plant: each is its nominal equation and a list of terms that change it.
//!
//! A term is the contribution of an effect to one subsystem; its trait is in the file of the
//! subsystem.

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

/// A subsystem of the rig, as results and reports name it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Subsystem {
    /// Pressure and contraction to force.
    MuscleForce,
    /// The weight with its friction, and what couples it to the encoder.
    Load,
    /// The servo valve.
    Valve,
    /// Command line and hose.
    Line,
    /// The air in the muscle.
    Gas,
    /// The air supply of the valve.
    Supply,
    /// The instruments.
    Sensor,
}

impl Subsystem {
    /// Its name in results.
    pub const fn name(self) -> &'static str {
        match self {
            Subsystem::MuscleForce => "muscle-force",
            Subsystem::Load => "load",
            Subsystem::Valve => "valve",
            Subsystem::Line => "line",
            Subsystem::Gas => "gas",
            Subsystem::Supply => "supply",
            Subsystem::Sensor => "sensor",
        }
    }
}

/// A term with the subsystem that it is added to.
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
