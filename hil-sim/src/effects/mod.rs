//! The catalogue of effects that can be added to the plant, one file each.
//!
//! An effect is a term for one block of the plant with its parameters, the mark it leaves in data,
//! and its sources. Adding one is a file here and its line in [`CATALOGUE`].

mod dead_band;
mod leak;
mod payload;
mod pressure_sensor_offset;
mod supply_droop;
mod transport_delay;
mod valve_lag;

use crate::plant::Term;

/// One parameter of an effect, as it stands in `[[effect]]` of a rig.
#[derive(Clone, Copy, Debug)]
pub struct Parameter {
    /// Its key; the unit is part of it.
    pub name: &'static str,
    /// Its unit, in the field's notation.
    pub unit: &'static str,
    /// Smallest value inside physics.
    pub min: f64,
    /// Largest value inside physics.
    pub max: f64,
}

/// One kind of effect.
#[derive(Clone, Copy, Debug)]
pub struct EffectKind {
    /// Its name, as other programs know it.
    pub name: &'static str,
    /// The block it is added to.
    pub block: &'static str,
    /// Its parameters, all required.
    pub parameters: &'static [Parameter],
    /// The mark it leaves in data, in words.
    pub mark: &'static str,
    /// Where its form comes from, and what that leaves out.
    pub source: &'static str,
    /// Makes the term from the values of `parameters`, in their order.
    pub build: fn(&[f64]) -> Term,
}

/// Every effect that a rig may name.
pub const CATALOGUE: &[EffectKind] = &[
    dead_band::KIND,
    leak::KIND,
    payload::KIND,
    pressure_sensor_offset::KIND,
    supply_droop::KIND,
    transport_delay::KIND,
    valve_lag::KIND,
];

/// The effect of that name, if the catalogue has it.
pub fn find(name: &str) -> Option<&'static EffectKind> {
    CATALOGUE.iter().find(|kind| kind.name == name)
}
