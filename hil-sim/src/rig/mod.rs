//! The rig: one muscle, its load, valve, air and lever, as `rig.toml` states them.

use crate::error::BadInput;
use model_core::assist::Assist;
use model_core::muscle::{Muscle, Volume};
use model_core::pressure::{AbsolutePa, GaugePa};
use muscle_plant::effects::{Catalogue, Effect};
use muscle_plant::nominal::{Gas, Load, Nominal, Valve, Weight};
use muscle_plant::simulation::{Plant, Simulated, SimulationError};
use std::ops::Range;
use std::path::Path;
use toml_edit::{Document, Item, TableLike, Value};

/// The version of the format.
const SCHEMA: i64 = 1;

/// How well a nominal value is known.
#[derive(Clone, Debug, PartialEq)]
pub struct Tolerance {
    /// The section of the value.
    pub section: String,
    /// The key of the value.
    pub key: String,
    /// Its relative standard deviation \[-\].
    pub relative_sigma: f64,
}

/// One rig. Sections that a use does not need may be absent.
#[derive(Clone, Debug)]
pub struct Rig {
    file: String,
    /// Where keys stand: `section.key` and the line.
    lines: Vec<(String, usize)>,
    /// The nominal values of the plant.
    pub nominal: Nominal,
    /// Eqs 6 and 7.
    pub assist: Option<Assist<f64>>,
    /// The effects that it may name.
    pub catalogue: Catalogue,
    /// What is not exact.
    pub tolerances: Vec<Tolerance>,
    /// What the nominal model leaves out.
    pub effects: Vec<Effect>,
}

/// Masses that a muscle may carry \[kg\].
pub const MASS_KG: std::ops::RangeInclusive<f64> = 1e-3..=1e5;

/// Limits of physics: section, key, smallest and largest value. What is at fault beyond them is
/// the file, not the rig.
const LIMITS: [(&str, &str, f64, f64); 21] = [
    ("muscle", "alpha_m2", 1e-9, 10.0),
    ("muscle", "beta_m2", -10.0, 10.0),
    ("muscle", "gamma_n", -1e5, 1e5),
    ("muscle", "volume_d1_m3", -10.0, 10.0),
    ("muscle", "volume_d2_m3", -10.0, 10.0),
    ("muscle", "volume_d3_m3", 1e-12, 10.0),
    ("muscle", "initial_length_m", 1e-3, 100.0),
    ("load", "mass_kg", *MASS_KG.start(), *MASS_KG.end()),
    ("load", "viscous_damping_ns_per_m", 0.0, 1e6),
    ("load", "coulomb_friction_n", 0.0, 1e5),
    ("load", "static_friction_n", 0.0, 1e5),
    ("valve", "flow_gain_kg_per_pa_s", 1e-14, 1e-3),
    ("valve", "supply_pressure_pa", 1.0, 1e8),
    ("gas", "ambient_temperature_k", 150.0, 500.0),
    ("gas", "atmospheric_pressure_pa", 1e3, 1e6),
    ("gas", "heat_transfer_charging_w_per_m2_k", 0.0, 1e6),
    ("gas", "heat_transfer_discharging_w_per_m2_k", 0.0, 1e6),
    ("assist", "gain", 0.0, 1e4),
    ("assist", "input_stiffness_n_per_m", 1e-3, 1e6),
    ("assist", "lever_length_m", 1e-3, 100.0),
    ("assist", "pulley_diameter_m", 1e-3, 100.0),
];

/// Contractions over which the volume must be positive.
const VOLUME_CONTRACTIONS: [f64; 4] = [0.0, 0.1, 0.2, 0.3];

impl Rig {
    /// The paper's rig, commented: what `hil-sim rig new` writes.
    pub const REFERENCE_TOML: &'static str = include_str!("reference_rig.toml");

    /// The paper's rig.
    ///
    /// # Panics
    /// Never: a test reads the embedded file.
    pub fn reference() -> Rig {
        Rig::parse("rig.toml", Rig::REFERENCE_TOML).expect("the embedded rig is valid")
    }

    /// Reads the file at `path`.
    ///
    /// # Errors
    /// It cannot be read, or is not a rig: see [`Rig::parse`].
    pub fn read(path: &Path) -> Result<Rig, BadInput> {
        Rig::parse(&path.display().to_string(), &Rig::read_text(path)?)
    }

    /// The text of the file at `path`, for [`Rig::parse`].
    ///
    /// # Errors
    /// It cannot be read, or is no text.
    pub fn read_text(path: &Path) -> Result<String, BadInput> {
        let name = path.display().to_string();
        let text = std::fs::read(path)
            .map_err(|error| BadInput::file(&name, format!("a readable TOML file, {error}")))?;
        String::from_utf8(text)
            .map_err(|_| BadInput::file(&name, "text in UTF-8, found other bytes"))
    }

    /// Reads a rig from the text of the file `name`.
    ///
    /// # Errors
    /// Anything that is not a rig, with its line and key: a wrong type, an unknown key, a value
    /// outside physics.
    pub fn parse(name: &str, text: &str) -> Result<Rig, BadInput> {
        Rig::parse_with(Catalogue::standard(), name, text)
    }

    /// As [`Rig::parse`], with the effects of `catalogue`.
    ///
    /// # Errors
    /// As [`Rig::parse`].
    pub fn parse_with(catalogue: Catalogue, name: &str, text: &str) -> Result<Rig, BadInput> {
        let document = Document::parse(text).map_err(|error| BadInput {
            file: name.into(),
            line: error.span().map(|span| line_of(text, span.start)),
            place: None,
            expected: format!("TOML, {}", error.message()),
        })?;
        let file = File {
            name,
            text,
            catalogue,
        };
        let rig = file.rig(document.as_table())?;
        rig.check()?;
        Ok(rig)
    }

    /// Relations between values.
    fn check(&self) -> Result<(), BadInput> {
        let muscle = &self.nominal.muscle;
        if muscle.alpha_m2 + muscle.beta_m2 <= 0.0 {
            let found = format!(
                "more than -alpha_m2 = {}, so that the muscle pulls at rest, found {}",
                -muscle.alpha_m2, muscle.beta_m2
            );
            return Err(self.bad("muscle.beta_m2", &found));
        }
        if let Some(volume) = &self.nominal.volume {
            for contraction in VOLUME_CONTRACTIONS {
                let volume_m3 = volume.volume_m3(contraction);
                if volume_m3 <= 0.0 {
                    let found = format!(
                        "a volume above 0, found {volume_m3:e} m³ at contraction {contraction}"
                    );
                    return Err(self.bad("muscle.volume_d1_m3", &found));
                }
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

    /// `text`, the rig's file, with the nominal values and effects of this rig; comments and
    /// whatever is the same stay.
    ///
    /// # Errors
    /// The text is no TOML.
    pub fn rewritten(&self, text: &str) -> Result<String, toml_edit::TomlError> {
        let mut document: toml_edit::DocumentMut = text.parse()?;
        let mut own = self.clone();
        for tolerance in &self.tolerances {
            let value = own
                .value_mut(&tolerance.section, &tolerance.key)
                .map(|value| *value);
            let item = document
                .get_mut(&tolerance.section)
                .and_then(|section| section.get_mut(&tolerance.key));
            if let (Some(value), Some(item)) = (value, item.and_then(|item| item.as_value_mut())) {
                let decor = item.decor().clone();
                *item = value.into();
                *item.decor_mut() = decor;
            }
        }
        let effects = document.get("effect");
        let tables = effects.and_then(|item| item.as_array_of_tables());
        let mut known = tables.map_or(0, |tables| tables.len());
        let inline = effects.and_then(|item| item.as_array());
        if let Some(inline) = inline.map(toml_edit::Array::len) {
            if inline == self.effects.len() {
                known = inline;
            } else {
                // No table can be added to an array: all become tables.
                document.remove("effect");
            }
        }
        let mut text = document.to_string();
        for effect in self.effects.iter().skip(known) {
            if !text.ends_with("\n\n") {
                text += if text.ends_with('\n') { "\n" } else { "\n\n" };
            }
            text += &effect_toml(effect);
        }
        Ok(text)
    }

    /// The nominal value at `section.key`, if the rig has it.
    pub fn value_mut(&mut self, section: &str, key: &str) -> Option<&mut f64> {
        let weight = match &mut self.nominal.load {
            Load::Weight(weight) => Some(weight),
            Load::Prescribed => None,
        };
        let (muscle, volume) = (&mut self.nominal.muscle, self.nominal.volume.as_mut());
        let (valve, gas) = (self.nominal.valve.as_mut(), self.nominal.gas.as_mut());
        Some(match (section, key) {
            ("muscle", "alpha_m2") => &mut muscle.alpha_m2,
            ("muscle", "beta_m2") => &mut muscle.beta_m2,
            ("muscle", "gamma_n") => &mut muscle.gamma_n,
            ("muscle", "initial_length_m") => &mut muscle.initial_length_m,
            ("muscle", "volume_d1_m3") => &mut volume?.d1_m3,
            ("muscle", "volume_d2_m3") => &mut volume?.d2_m3,
            ("muscle", "volume_d3_m3") => &mut volume?.d3_m3,
            ("load", "mass_kg") => &mut weight?.mass_kg,
            ("load", "viscous_damping_ns_per_m") => &mut weight?.viscous_damping_ns_per_m,
            ("load", "coulomb_friction_n") => &mut weight?.coulomb_friction_n,
            ("load", "static_friction_n") => &mut weight?.static_friction_n,
            ("valve", "flow_gain_kg_per_pa_s") => &mut valve?.flow_gain_kg_per_pa_s,
            ("valve", "supply_pressure_pa") => &mut valve?.supply_pressure.0,
            ("gas", "ambient_temperature_k") => &mut gas?.ambient_temperature_k,
            ("gas", "atmospheric_pressure_pa") => &mut gas?.atmospheric_pressure.0,
            ("gas", "heat_transfer_charging_w_per_m2_k") => {
                &mut gas?.heat_transfer_charging_w_per_m2_k
            }
            ("gas", "heat_transfer_discharging_w_per_m2_k") => {
                &mut gas?.heat_transfer_discharging_w_per_m2_k
            }
            _ => return None,
        })
    }

    /// The plant of this rig with its effects, as far as it is `simulated`.
    ///
    /// # Errors
    /// A section is needed and missing, or the effects have too many states.
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

    /// Bad input for a simulation of this rig that ended early, where no other input is at fault.
    pub fn unsolvable(&self, error: SimulationError) -> BadInput {
        self.bad_file(&format!("a rig whose plant can be followed, {error}"))
    }

    /// Bad input at `section.key`, with its line where the key stands in the file.
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

    fn missing(&self, key: &str, what: &str) -> BadInput {
        self.bad(key, &format!("{what}, found none"))
    }

    /// The valve.
    ///
    /// # Errors
    /// The rig has none.
    pub fn require_valve(&self) -> Result<&Valve, BadInput> {
        let what = "this section, as the record's `pressure_ref_pa` asks for a valve";
        self.nominal
            .valve
            .as_ref()
            .ok_or_else(|| self.missing("valve", what))
    }

    /// The air.
    ///
    /// # Errors
    /// The rig has none.
    pub fn require_gas(&self) -> Result<&Gas, BadInput> {
        let what = "this section, as the pressure is simulated";
        self.nominal
            .gas
            .as_ref()
            .ok_or_else(|| self.missing("gas", what))
    }

    /// Eq 2.
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
    /// The rig has none.
    pub fn require_assist(&self) -> Result<&Assist<f64>, BadInput> {
        let what = "this section, as the assist is simulated";
        self.assist
            .as_ref()
            .ok_or_else(|| self.missing("assist", what))
    }
}

/// The effect as a section of `rig.toml`, which reads back to the same values.
pub fn effect_toml(effect: &Effect) -> String {
    let mut text = format!("[[effect]]\nname = \"{}\"\n", effect.kind.name);
    // The first form needs no name.
    if effect.form.name != effect.kind.forms[0].name {
        text += &format!("form = \"{}\"\n", effect.form.name);
    }
    for (parameter, value) in effect.form.parameters.iter().zip(&effect.values) {
        text += &format!("{} = {value:?}\n", parameter.name);
    }
    text
}

fn line_of(text: &str, offset: usize) -> usize {
    let before = text.as_bytes().iter().take(offset);
    1 + before.filter(|byte| **byte == b'\n').count()
}

/// A rig file while it is read.
struct File<'a> {
    name: &'a str,
    text: &'a str,
    catalogue: Catalogue,
}

/// One table of the file and where it stands.
struct Section<'a> {
    file: &'a File<'a>,
    /// Its name; empty for the whole file.
    name: String,
    table: &'a dyn TableLike,
    line: Option<usize>,
}

impl<'a> Section<'a> {
    fn key(&self, key: &str) -> String {
        match self.name.as_str() {
            "" => key.into(),
            name => format!("{name}.{key}"),
        }
    }

    /// The line of `key`, or of the section where it is missing.
    fn line(&self, key: &str) -> Option<usize> {
        let span = self.table.get_key_value(key).and_then(|(key, item)| {
            // Keys of tables in brackets carry their span in the table.
            key.span().or_else(|| item.span())
        });
        let line = span.map(|span| line_of(self.file.text, span.start));
        line.or(self.line)
    }

    fn bad(&self, key: &str, expected: impl Into<String>) -> BadInput {
        BadInput {
            file: self.file.name.into(),
            line: self.line(key),
            place: Some(format!("key `{}`", self.key(key))),
            expected: expected.into(),
        }
    }

    /// Refuses every key that is not `known`.
    fn only(&self, known: &[&str]) -> Result<(), BadInput> {
        match self.table.iter().find(|(key, _)| !known.contains(key)) {
            None => Ok(()),
            Some((key, _)) => Err(self.bad(
                key,
                format!("one of the keys {}, found this", known.join(", ")),
            )),
        }
    }

    /// A number, if the key is there.
    fn optional(&self, key: &str, min: f64, max: f64) -> Result<Option<f64>, BadInput> {
        let Some(item) = self.table.get(key) else {
            return Ok(None);
        };
        let value = match item {
            Item::Value(Value::Float(value)) => *value.value(),
            Item::Value(Value::Integer(value)) => *value.value() as f64,
            other => return Err(self.bad(key, format!("a number, found {}", kind_of(other)))),
        };
        if value >= min && value <= max {
            return Ok(Some(value));
        }
        Err(self.bad(
            key,
            format!("a number from {min:e} to {max:e}, found {value}"),
        ))
    }

    /// A number within the limits of physics.
    fn number(&self, key: &str) -> Result<f64, BadInput> {
        let mut limits = LIMITS.iter();
        let limit = limits.find(|(section, known, ..)| *section == self.name && *known == key);
        let (.., min, max) = limit.unwrap_or(&("", "", f64::MIN, f64::MAX));
        self.optional(key, *min, *max)?
            .ok_or_else(|| self.bad(key, "a number, found no such key"))
    }

    fn word(&self, key: &str) -> Result<&'a str, BadInput> {
        match self.table.get(key) {
            Some(Item::Value(Value::String(value))) => Ok(value.value()),
            Some(other) => Err(self.bad(key, format!("a string, found {}", kind_of(other)))),
            None => Err(self.bad(key, "a string, found no such key")),
        }
    }

    /// The table under `key`.
    fn section(&self, key: &str) -> Result<Option<Section<'a>>, BadInput> {
        match self.table.get(key) {
            None => Ok(None),
            Some(item) => match item.as_table_like() {
                None => Err(self.bad(key, format!("a section, found {}", kind_of(item)))),
                Some(table) => Ok(Some(Section {
                    file: self.file,
                    name: self.key(key),
                    table,
                    line: self.line(key),
                })),
            },
        }
    }
}

fn kind_of(item: &Item) -> &'static str {
    match item {
        Item::Table(_) | Item::Value(Value::InlineTable(_)) => "a section",
        other => other.type_name(),
    }
}

/// The keys of a section that have limits.
fn keys_of(section: &str) -> Vec<&'static str> {
    let limits = LIMITS.iter().filter(|(known, ..)| *known == section);
    limits.map(|(_, key, ..)| *key).collect()
}

impl<'a> File<'a> {
    fn rig(&'a self, table: &'a dyn TableLike) -> Result<Rig, BadInput> {
        let root = Section {
            file: self,
            name: String::new(),
            table,
            line: None,
        };
        root.only(&[
            "schema",
            "muscle",
            "load",
            "valve",
            "gas",
            "assist",
            "tolerance",
            "effect",
        ])?;
        match root.optional("schema", f64::MIN, f64::MAX)? {
            Some(schema) if schema == SCHEMA as f64 => {}
            Some(schema) => {
                return Err(root.bad("schema", format!("{SCHEMA}, found {schema}")));
            }
            None => return Err(root.bad("schema", format!("{SCHEMA}, found no such key"))),
        }
        let required = |key: &str| {
            let section = root.section(key)?;
            section.ok_or_else(|| root.bad(key, "this section, found none"))
        };
        let mut lines = Vec::new();
        for (section, item) in root.table.iter() {
            if let (Some(section), true) =
                (root.section(section).ok().flatten(), item.is_table_like())
            {
                let keys = section.table.iter();
                lines.extend(
                    keys.filter_map(|(key, _)| Some((section.key(key), section.line(key)?))),
                );
                lines.extend(section.line.map(|line| (section.name.clone(), line)));
            }
        }
        lines.extend(root.line("effect").map(|line| ("effect".into(), line)));
        let (muscle, volume) = muscle(&required("muscle")?)?;
        Ok(Rig {
            file: self.name.into(),
            lines,
            nominal: Nominal {
                muscle,
                volume,
                load: load(&required("load")?)?,
                valve: root
                    .section("valve")?
                    .map(|section| valve(&section))
                    .transpose()?,
                gas: root
                    .section("gas")?
                    .map(|section| gas(&section))
                    .transpose()?,
            },
            assist: root
                .section("assist")?
                .map(|section| assist(&section))
                .transpose()?,
            catalogue: self.catalogue.clone(),
            tolerances: tolerances(&root)?,
            effects: all_effects(&root)?,
        })
    }
}

fn muscle(section: &Section) -> Result<(Muscle<f64>, Option<Volume<f64>>), BadInput> {
    section.only(&keys_of("muscle"))?;
    let muscle = Muscle {
        alpha_m2: section.number("alpha_m2")?,
        beta_m2: section.number("beta_m2")?,
        gamma_n: section.number("gamma_n")?,
        initial_length_m: section.number("initial_length_m")?,
    };
    // A bench whose pressure is measured needs no volume.
    let keys = ["volume_d1_m3", "volume_d2_m3", "volume_d3_m3"];
    if !keys.iter().any(|key| section.table.contains_key(key)) {
        return Ok((muscle, None));
    }
    let [d1_m3, d2_m3, d3_m3] = keys.map(|key| section.number(key));
    let volume = Volume {
        d1_m3: d1_m3?,
        d2_m3: d2_m3?,
        d3_m3: d3_m3?,
    };
    Ok((muscle, Some(volume)))
}

fn load(section: &Section) -> Result<Load, BadInput> {
    let keys = keys_of("load");
    section.only(&[&["kind"], keys.as_slice()].concat())?;
    match section.word("kind")? {
        "prescribed" => {
            // A weight's keys may stay in the file while the muscle is on the bench.
            for key in keys
                .into_iter()
                .filter(|key| section.table.contains_key(key))
            {
                section.number(key)?;
            }
            Ok(Load::Prescribed)
        }
        "weight" => Ok(Load::Weight(Weight {
            mass_kg: section.number("mass_kg")?,
            viscous_damping_ns_per_m: section.number("viscous_damping_ns_per_m")?,
            coulomb_friction_n: section.number("coulomb_friction_n")?,
            static_friction_n: section.number("static_friction_n")?,
        })),
        other => {
            let expected = format!("\"weight\" or \"prescribed\", found \"{other}\"");
            Err(section.bad("kind", expected))
        }
    }
}

fn valve(section: &Section) -> Result<Valve, BadInput> {
    section.only(&keys_of("valve"))?;
    Ok(Valve {
        flow_gain_kg_per_pa_s: section.number("flow_gain_kg_per_pa_s")?,
        supply_pressure: GaugePa(section.number("supply_pressure_pa")?),
    })
}

fn gas(section: &Section) -> Result<Gas, BadInput> {
    section.only(&keys_of("gas"))?;
    Ok(Gas {
        ambient_temperature_k: section.number("ambient_temperature_k")?,
        atmospheric_pressure: AbsolutePa(section.number("atmospheric_pressure_pa")?),
        heat_transfer_charging_w_per_m2_k: section.number("heat_transfer_charging_w_per_m2_k")?,
        heat_transfer_discharging_w_per_m2_k: section
            .number("heat_transfer_discharging_w_per_m2_k")?,
    })
}

fn assist(section: &Section) -> Result<Assist<f64>, BadInput> {
    section.only(&keys_of("assist"))?;
    Ok(Assist {
        gain: section.number("gain")?,
        input_stiffness_n_per_m: section.number("input_stiffness_n_per_m")?,
        lever_length_m: section.number("lever_length_m")?,
        pulley_diameter_m: section.number("pulley_diameter_m")?,
    })
}

fn tolerances(root: &Section) -> Result<Vec<Tolerance>, BadInput> {
    let Some(all) = root.section("tolerance")? else {
        return Ok(Vec::new());
    };
    all.only(&["muscle", "load", "valve", "gas"])?;
    let mut tolerances = Vec::new();
    for (name, _) in all.table.iter() {
        let Some(section) = all.section(name)? else {
            continue;
        };
        section.only(&keys_of(name))?;
        for (key, _) in section.table.iter() {
            if let Some(relative_sigma) = section.optional(key, 0.0, 10.0)? {
                tolerances.push(Tolerance {
                    section: name.into(),
                    key: key.into(),
                    relative_sigma,
                });
            }
        }
    }
    Ok(tolerances)
}

fn all_effects(root: &Section) -> Result<Vec<Effect>, BadInput> {
    let one = |table: &dyn TableLike, span: Option<Range<usize>>| {
        effect(&Section {
            file: root.file,
            name: "effect".into(),
            table,
            line: span.map(|span| line_of(root.file.text, span.start)),
        })
    };
    let bad = |found: &str| {
        let expected = format!("sections `[[effect]]`, found {found}");
        root.bad("effect", expected)
    };
    match root.table.get("effect") {
        None => Ok(Vec::new()),
        Some(Item::ArrayOfTables(tables)) => {
            let effects = tables.iter().map(|table| one(table, table.span()));
            effects.collect()
        }
        // `effect = [{ name = … }]` is the same in TOML.
        Some(Item::Value(Value::Array(values))) => {
            let effects = values.iter().map(|value| match value {
                Value::InlineTable(table) => one(table, table.span()),
                other => Err(bad(other.type_name())),
            });
            effects.collect()
        }
        Some(other) => Err(bad(kind_of(other))),
    }
}

fn effect(section: &Section) -> Result<Effect, BadInput> {
    let name = section.word("name")?;
    let catalogue = &section.file.catalogue;
    let Some(kind) = catalogue.find(name) else {
        let known: Vec<_> = catalogue.kinds().map(|kind| kind.name).collect();
        let expected = format!("one of {}, found \"{name}\"", known.join(", "));
        return Err(section.bad("name", expected));
    };
    let form = match section.table.contains_key("form") {
        false => &kind.forms[0],
        true => {
            let name = section.word("form")?;
            kind.form(name).ok_or_else(|| {
                let known: Vec<_> = kind.forms.iter().map(|form| form.name).collect();
                let expected = format!("one of {}, found \"{name}\"", known.join(", "));
                section.bad("form", expected)
            })?
        }
    };
    let parameters = form.parameters.iter();
    let keys: Vec<_> = parameters.map(|parameter| parameter.name).collect();
    section.only(&[&["name", "form"], keys.as_slice()].concat())?;
    let mut values = Vec::new();
    for parameter in form.parameters {
        let value = section.optional(parameter.name, parameter.min, parameter.max)?;
        let missing = || {
            let expected = format!("a number [{}], found no such key", parameter.unit);
            section.bad(parameter.name, expected)
        };
        values.push(value.ok_or_else(missing)?);
    }
    Ok(Effect { kind, form, values })
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

    #[test]
    fn errors_name_the_line_of_the_key() {
        let text = Rig::REFERENCE_TOML.replace("mass_kg = 12.0", "mass_kg = -12.0");
        let error = Rig::parse("rig.toml", &text).expect_err("a negative mass");
        let line = text
            .lines()
            .position(|line| line.starts_with("mass_kg"))
            .map(|line| line + 1);
        assert_eq!(error.line, line);
        assert!(
            error
                .to_string()
                .contains("key `load.mass_kg`: expected a number from")
        );
    }

    #[test]
    fn effects_come_with_their_values() {
        let text = Rig::REFERENCE_TOML.to_owned()
            + "[[effect]]\nname = \"leak\"\nconductance_kg_per_pa_s = 4e-9\n";
        let rig = Rig::parse("rig.toml", &text).expect("a rig");
        assert_eq!(rig.effects[0].kind.name, "leak");
        assert_eq!(rig.effects[0].values, [4e-9]);
    }

    #[test]
    fn effects_may_stand_in_an_array() {
        let schema = "schema = 1\n";
        assert!(Rig::REFERENCE_TOML.contains(schema));
        let parse = |effects: &str| {
            let text = format!("{schema}effect = [\n{effects}\n]\n");
            Rig::parse("rig.toml", &Rig::REFERENCE_TOML.replace(schema, &text))
        };
        let leak = "{ name = \"leak\", conductance_kg_per_pa_s = 4e-9 },";
        let rig = parse(&[leak, leak].join("\n")).expect("a rig");
        assert_eq!(rig.effects.len(), 2);
        assert_eq!(rig.effects[1].values, [4e-9]);
        let error = parse(&[leak, "{ name = \"leek\" }"].join("\n")).expect_err("no such effect");
        let line = |rig: &Rig| rig.bad("effect", "").line;
        assert_eq!(error.line, line(&rig).map(|line| line + 2));
        assert_eq!(error.place.as_deref(), Some("key `effect.name`"));
        let error = parse("4e-9").expect_err("no section");
        assert!(error.expected.ends_with("found float"), "{error}");
    }

    #[test]
    fn an_effect_joins_those_of_an_array() {
        let array = "schema = 1\neffect = [{ name = \"leak\", conductance_kg_per_pa_s = 4e-9 }]\n";
        let text = Rig::REFERENCE_TOML.replace("schema = 1\n", array);
        let mut rig = Rig::parse("rig.toml", &text).expect("a rig");
        assert_eq!(rig.rewritten(&text).as_ref(), Ok(&text));
        rig.effects.push(rig.effects[0].clone());
        let both = rig.rewritten(&text).expect("TOML");
        let read = Rig::parse("rig.toml", &both).expect("a rig");
        assert_eq!(read.effects.len(), 2);
        assert_eq!(read.effects[1].values, [4e-9]);
    }
}
