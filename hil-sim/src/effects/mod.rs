//! The catalogue of effects that can be added to the plant, one file each.

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
}

/// Every effect that a rig may name.
pub const CATALOGUE: &[EffectKind] = &[];

/// The effect of that name, if the catalogue has it.
pub fn find(name: &str) -> Option<&'static EffectKind> {
    CATALOGUE.iter().find(|kind| kind.name == name)
}
