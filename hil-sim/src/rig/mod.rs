//! The rig: one muscle with its load, valve, gas and lever, as described by `rig.toml`.

mod edit;
mod keys;
mod provenance;
mod read;
mod units;

pub use edit::{effect_toml, set_numbers};
pub use keys::{DefaultTolerance, KEYS, Key, MASS_KG, default_tolerances, uncalibrated};
pub use provenance::{FileHash, FoundEffect, Provenance, UsedRecord};

use crate::error::BadInput;
use crate::input::read_text;
use model_core::assist::Assist;
use model_core::muscle::Volume;
use muscle_plant::effects::{Catalogue, Effect, EffectKind};
use muscle_plant::nominal::{Gas, Load, Nominal, Valve};
use muscle_plant::simulation::{Plant, Simulated, SimulationError};
use std::path::Path;
use toml_edit::{Item, Table};

/// The uncertainty of one nominal value.
#[derive(Clone, Debug, PartialEq)]
pub struct Tolerance {
    /// Section of the value.
    pub section: String,
    /// Key of the value.
    pub key: String,
    /// Relative standard deviation \[-\].
    pub relative_sigma: f64,
}

/// One rig. Sections that a use does not need may be absent.
#[derive(Clone, Debug)]
pub struct Rig {
    file: String,
    /// `section.key` and its line.
    lines: Vec<(String, usize)>,
    /// Nominal values of the plant.
    pub nominal: Nominal,
    /// Lever and assist law: Eqs 6 and 7.
    pub assist: Option<Assist<f64>>,
    /// The effects that the file may name: the standard ones and its own.
    pub catalogue: Catalogue,
    /// What the files beside it declare, by the effects' names, and what a diagnosis added.
    pub(crate) own_effects: Table,
    /// Relative standard deviations of the nominal values; a value without one is exact.
    pub tolerances: Vec<Tolerance>,
    /// Effects in addition to the nominal model.
    pub effects: Vec<Effect>,
    /// Where a fitted rig comes from; nothing is computed with it.
    pub provenance: Option<Provenance>,
}

/// Contractions at which the volume must be positive.
const VOLUME_CONTRACTIONS: [f64; 4] = [0.0, 0.1, 0.2, 0.3];

impl Rig {
    /// The paper's rig, commented, each value exact.
    pub const REFERENCE_TOML: &'static str = include_str!("reference_rig.toml");

    /// The paper's rig, commented, with the tolerances of uncalibrated values: what `hil-sim rig
    /// new` writes.
    pub fn template() -> String {
        let effects = "# Effects beyond";
        let tolerances = default_tolerances(&Rig::reference());
        Rig::REFERENCE_TOML.replacen(effects, &format!("{tolerances}\n{effects}"), 1)
    }

    /// The paper's rig.
    ///
    /// # Panics
    /// If the embedded file is not a rig, which a test excludes.
    pub fn reference() -> Rig {
        Rig::parse("rig.toml", Rig::REFERENCE_TOML).expect("the embedded rig is valid")
    }

    /// Reads the file at `path`.
    ///
    /// # Errors
    /// The file cannot be read, or is not a rig: see [`Rig::parse`].
    pub fn read(path: &Path) -> Result<Rig, BadInput> {
        Rig::parse(&path.display().to_string(), &Rig::read_text(path)?)
    }

    /// The text of the file at `path`, for [`Rig::parse`].
    ///
    /// # Errors
    /// The file cannot be read, or is not UTF-8.
    pub fn read_text(path: &Path) -> Result<String, BadInput> {
        read_text(path, "a readable TOML file")
    }

    /// Reads a rig from the text of the file `name`.
    ///
    /// # Errors
    /// The text is not a rig, with line and key: a wrong type, an unknown key, a value outside its
    /// range.
    pub fn parse(name: &str, text: &str) -> Result<Rig, BadInput> {
        Rig::parse_with(Catalogue::standard(), name, text)
    }

    /// As [`Rig::parse`], with the effects of `catalogue`.
    ///
    /// # Errors
    /// As [`Rig::parse`].
    pub fn parse_with(catalogue: Catalogue, name: &str, text: &str) -> Result<Rig, BadInput> {
        let rig = read::rig(catalogue, name, text)?;
        rig.check()?;
        Ok(rig)
    }

    /// Adds an effect of one's own, which `table` declares, to those that the file may name.
    pub(crate) fn declare(&mut self, kind: &'static EffectKind, table: Item) {
        self.catalogue = self.catalogue.clone().with(kind);
        self.own_effects.insert(kind.name, table);
    }

    /// Checks relations between values.
    ///
    /// # Errors
    /// The muscle does not pull at rest or has no volume, or a friction at rest is below that of
    /// motion.
    pub fn check(&self) -> Result<(), BadInput> {
        let muscle = &self.nominal.muscle;
        if muscle.alpha_m2 + muscle.beta_m2 <= 0.0 {
            let found = format!(
                "more than -alpha_m2 = {}, so that the muscle pulls at rest, found {}",
                -muscle.alpha_m2, muscle.beta_m2
            );
            return Err(self.bad("muscle.beta_m2", &found));
        }
        for (contraction, volume_m3) in self.volumes_m3() {
            if volume_m3 <= 0.0 {
                let found = format!(
                    "a volume above 0, found {volume_m3:e} m³ at contraction {contraction}"
                );
                return Err(self.bad("muscle.volume_d1_m3", &found));
            }
        }
        if let Load::Weight(weight) = &self.nominal.load {
            let (coulomb_n, static_n) = (weight.coulomb_friction_n, weight.static_friction_n);
            if static_n < coulomb_n {
                let found = format!("at least coulomb_friction_n = {coulomb_n}, found {static_n}");
                return Err(self.bad("load.static_friction_n", &found));
            }
        }
        Ok(())
    }

    /// The contractions at which the muscle must have a volume, and the volume there.
    pub(crate) fn volumes_m3(&self) -> impl Iterator<Item = (f64, f64)> {
        let volume = self.nominal.volume.iter();
        volume.flat_map(|volume| {
            VOLUME_CONTRACTIONS.map(|contraction| (contraction, volume.volume_m3(contraction)))
        })
    }

    /// The value at `section.key`, if the rig has it.
    pub fn value_mut(&mut self, section: &str, key: &str) -> Option<&mut f64> {
        let key = keys::of_section(section).find(|known| known.name == key)?;
        (key.value)(self)
    }

    /// The plant of this rig with its effects; `simulated` tells which quantities are simulated and
    /// which are inputs.
    ///
    /// # Errors
    /// A section that is needed is missing, or the effects have too many states.
    pub fn plant(&self, simulated: Simulated) -> Result<Plant, BadInput> {
        if simulated.pressure {
            self.require_valve()?;
            self.require_gas()?;
            self.require_volume()?;
        }
        let terms = self.effects.iter().map(Effect::term);
        Plant::new(&self.nominal, terms, simulated)
            .map_err(|error| self.bad("effect", &format!("a plant that can be built, {error}")))
    }

    /// Bad input for a simulation that failed, if the rig is its only input.
    pub fn unsolvable(&self, error: SimulationError) -> BadInput {
        self.bad_file(&format!("a rig whose plant can be integrated, {error}"))
    }

    /// Bad input at `section.key`, with its line if the file has the key.
    pub fn bad(&self, key: &str, expected: &str) -> BadInput {
        let mut lines = self.lines.iter();
        BadInput {
            file: self.file.clone(),
            line: lines.find(|(known, _)| known == key).map(|(_, line)| *line),
            place: Some(format!("key `{key}`")),
            expected: expected.into(),
        }
    }

    /// Bad input in the file as a whole.
    pub fn bad_file(&self, expected: &str) -> BadInput {
        BadInput::file(&self.file, expected)
    }

    /// Bad input for a part that a use needs and the file lacks.
    fn missing(&self, key: &str, what: &str) -> BadInput {
        self.bad(key, &format!("{what}, found none"))
    }

    /// The valve and its supply.
    ///
    /// # Errors
    /// The rig has no section `valve`.
    pub fn require_valve(&self) -> Result<&Valve, BadInput> {
        let what = "this section, as the record has a `pressure_ref_pa`";
        self.nominal
            .valve
            .as_ref()
            .ok_or_else(|| self.missing("valve", what))
    }

    /// The gas and its heat transfer.
    ///
    /// # Errors
    /// The rig has no section `gas`.
    pub fn require_gas(&self) -> Result<&Gas, BadInput> {
        let what = "this section, as the pressure is simulated";
        self.nominal
            .gas
            .as_ref()
            .ok_or_else(|| self.missing("gas", what))
    }

    /// The muscle's volume, Eq 2.
    ///
    /// # Errors
    /// The rig has no volume.
    pub fn require_volume(&self) -> Result<&Volume<f64>, BadInput> {
        let what = "the volume, as the pressure is simulated";
        let volume = self.nominal.volume.as_ref();
        volume.ok_or_else(|| self.missing("muscle.volume_d1_m3", what))
    }

    /// The lever and the assist law.
    ///
    /// # Errors
    /// The rig has no section `assist`.
    pub fn require_assist(&self) -> Result<&Assist<f64>, BadInput> {
        let what = "this section with gain, input_stiffness_n_per_m, lever_length_m and \
                    pulley_diameter_m, as the assist is simulated (`hil-sim rig new` writes one)";
        self.assist
            .as_ref()
            .ok_or_else(|| self.missing("assist", what))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_reference_rig_is_complete() {
        let rig = Rig::reference();
        assert!(rig.require_valve().is_ok() && rig.require_gas().is_ok());
        assert!(rig.require_volume().is_ok() && rig.require_assist().is_ok());
        assert!(matches!(rig.nominal.load, Load::Weight(weight) if weight.mass_kg == 12.0));
    }
}
