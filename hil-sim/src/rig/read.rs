//! Reading a rig file: TOML with the line of each key.

use super::keys::{self, Key};
use super::units::likely_unit;
use super::{Provenance, Rig, Tolerance};
use crate::error::{BadInput, did_you_mean, one_of, shown};
use crate::own_effect;
use crate::record::TIME_S;
use model_core::assist::Assist;
use model_core::muscle::{Muscle, Volume};
use model_core::pressure::{AbsolutePa, GaugePa};
use muscle_plant::effects::{Catalogue, Effect};
use muscle_plant::nominal::{Gas, Load, Nominal, Valve, Weight};
use std::ops::Range;
use std::path::Path;
use toml_edit::{Document, Item, Table, TableLike, Value};

/// Version of the file format.
const SCHEMA: i64 = 1;

/// The value of a number that has not been read yet.
const UNREAD: f64 = f64::NAN;

/// Reads a rig from the text of the file `name`, with the effects of `catalogue`.
pub(super) fn rig(catalogue: Catalogue, name: &str, text: &str) -> Result<Rig, BadInput> {
    let document = Document::parse(text).map_err(|error| {
        let line = error.span().map(|span| line_of(text, span.start));
        let words = line.and_then(|line| text.lines().nth(line - 1));
        let number = words.and_then(misspelt_number);
        let found = error.span().and_then(|span| text.get(span));
        BadInput {
            file: name.into(),
            line,
            place: None,
            expected: match (text.lines().next(), number) {
                // A record in the place of a rig.
                (Some(first), _) if first.contains(TIME_S) => {
                    format!("a rig in TOML, found `{first}`")
                }
                _ if text.trim_start().starts_with('{') => "a rig in TOML, found JSON".into(),
                (_, Some(expected)) => expected,
                _ if error.message() == "duplicate key" => {
                    let found = found.unwrap_or("one").trim_matches(['[', ']']);
                    format!("each key and each section once, found `{found}` again")
                }
                _ => format!("TOML, {}", error.message()),
            },
        }
    })?;
    let mut file = File {
        name,
        text,
        catalogue,
        own_effects: Table::new(),
    };
    (file.catalogue, file.own_effects) = file.with_own_effects(document.as_table())?;
    file.rig(document.as_table())
}

/// What is expected in a line of TOML whose value is a number of another spelling: with a comma, a
/// minus of typesetters, or its unit.
fn misspelt_number(line: &str) -> Option<String> {
    let value = line.split_once('=')?.1.split('#').next()?.trim();
    let is_number = |text: &str| text.parse::<f64>().is_ok();
    let expected = if is_number(&value.replacen(',', ".", 1)) {
        "a decimal point"
    } else if is_number(&value.replace(['\u{2212}', '\u{2013}'], "-")) {
        "the minus sign of the keyboard"
    } else if is_number(value.split(' ').next()?) {
        "a number without its unit, which the key names"
    } else {
        return None;
    };
    (!is_number(value)).then(|| format!("{expected}, found {value}"))
}

/// The line of the byte at `offset`, from 1.
fn line_of(text: &str, offset: usize) -> usize {
    let before = text.as_bytes().iter().take(offset);
    1 + before.filter(|byte| **byte == b'\n').count()
}

/// The file that is being read.
struct File<'a> {
    name: &'a str,
    text: &'a str,
    catalogue: Catalogue,
    /// What the files beside it declare.
    own_effects: Table,
}

/// One table of the file and its position.
struct Section<'a> {
    file: &'a File<'a>,
    /// Name of the table; empty for the root.
    name: String,
    table: &'a dyn TableLike,
    line: Option<usize>,
}

impl<'a> Section<'a> {
    /// The file as a whole.
    fn root(file: &'a File, table: &'a dyn TableLike) -> Section<'a> {
        Section {
            file,
            name: String::new(),
            table,
            line: None,
        }
    }

    /// `key` with its section, as messages name it.
    fn key(&self, key: &str) -> String {
        match self.name.as_str() {
            "" => key.into(),
            name => format!("{name}.{key}"),
        }
    }

    /// The line of `key`, or of the section if the key is missing.
    fn line(&self, key: &str) -> Option<usize> {
        let span = self.table.get_key_value(key).and_then(|(key, item)| {
            // The parser gives keys of bracketed tables no span; their table has one.
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

    /// An error for each key of the table other than `known`.
    fn unknown(&self, known: &[&str]) -> impl Iterator<Item = BadInput> {
        let keys = self.table.iter().map(|(key, _)| key);
        keys.filter(|key| !known.contains(key)).map(|key| {
            let expected = format!("one of the keys {}, found this", known.join(", "));
            self.bad(key, expected + &did_you_mean(key, known))
        })
    }

    /// Refuses a table that has a key other than `known`.
    fn only(&self, known: &[&str]) -> Result<(), BadInput> {
        self.unknown(known).next().map_or(Ok(()), Err)
    }

    /// A number from `min` to `max`, if the table has `key`.
    fn optional(&self, key: &str, min: f64, max: f64) -> Result<Option<f64>, BadInput> {
        let Some(item) = self.table.get(key) else {
            return Ok(None);
        };
        let value = number_of(item)
            .ok_or_else(|| self.bad(key, format!("a number, found {}", kind_of(item))))?;
        if value >= min && value <= max {
            return Ok(Some(value));
        }
        Err(self.bad(
            key,
            format!(
                "a number from {} to {}, found {}",
                shown(min),
                shown(max),
                shown(value)
            ),
        ))
    }

    /// The number at `key`, if the table has it.
    fn optional_number(&self, key: &Key) -> Result<Option<f64>, BadInput> {
        let found = self.table.get(key.name).and_then(number_of);
        self.optional(key.name, key.min, key.max).map_err(|error| {
            let likely = found.map(|value| likely_unit(key, value));
            BadInput {
                expected: error.expected + &likely.unwrap_or_default(),
                ..error
            }
        })
    }

    /// The number at `key`.
    fn number(&self, key: &Key) -> Result<f64, BadInput> {
        self.optional_number(key)?
            .ok_or_else(|| self.bad(key.name, "a number, found no such key"))
    }

    /// The string at `key`.
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

/// The number that `item` is.
fn number_of(item: &Item) -> Option<f64> {
    match item {
        Item::Value(Value::Float(value)) => Some(*value.value()),
        Item::Value(Value::Integer(value)) => Some(*value.value() as f64),
        _ => None,
    }
}

/// The type of `item`, as messages name it.
fn kind_of(item: &Item) -> &'static str {
    match item {
        Item::Table(_) | Item::Value(Value::InlineTable(_)) => "a section",
        other => other.type_name(),
    }
}

impl<'a> File<'a> {
    /// The catalogue with the effects that the file and those beside it declare, and the tables of
    /// the latter.
    fn with_own_effects(&self, table: &dyn TableLike) -> Result<(Catalogue, Table), BadInput> {
        let root = Section::root(self, table);
        let mut catalogue = self.catalogue.clone();
        let mut tables = Table::new();
        if let Some(item) = table.get(own_effect::FILES_KEY) {
            let expected = "an array of file names beside the rig, as [\"pulley.toml\"]";
            let bad = || root.bad(own_effect::FILES_KEY, expected);
            let folder = Path::new(self.name).parent().unwrap_or(Path::new(""));
            for name in item.as_array().ok_or_else(bad)? {
                let path = folder.join(name.as_str().ok_or_else(bad)?);
                let (kinds, found) = own_effect::read_file(&path)?;
                catalogue = kinds.into_iter().fold(catalogue, Catalogue::with);
                for (name, declared) in found {
                    if tables.insert(&name, declared).is_some() {
                        let found = format!("each effect in one of them, found {name} in two");
                        return Err(root.bad(own_effect::FILES_KEY, found));
                    }
                }
            }
        }
        if let Some(own) = table.get(own_effect::KEY) {
            let twice = tables.iter().map(|(name, _)| name);
            let mut twice = twice.filter(|name| own.get(name).is_some());
            if let Some(name) = twice.next() {
                let expected = format!("effects that no file beside the rig has, found {name}");
                return Err(root.bad(own_effect::KEY, expected));
            }
            let declared = own_effect::from_toml(self.name, self.text)?;
            catalogue = declared.into_iter().fold(catalogue, Catalogue::with);
        }
        Ok((catalogue, tables))
    }

    fn rig(&'a self, table: &'a dyn TableLike) -> Result<Rig, BadInput> {
        let root = Section::root(self, table);
        let sections = keys::sections(|_| true);
        root.only(
            &[
                &["schema"],
                sections.as_slice(),
                &[
                    "tolerance",
                    "effect",
                    own_effect::KEY,
                    own_effect::FILES_KEY,
                    "provenance",
                ],
            ]
            .concat(),
        )?;
        match root.optional("schema", f64::MIN, f64::MAX)? {
            Some(schema) if schema == SCHEMA as f64 => {}
            Some(schema) => {
                return Err(root.bad("schema", format!("{SCHEMA}, found {schema}")));
            }
            None => return Err(root.bad("schema", format!("{SCHEMA}, found no such key"))),
        }
        let mut rig = Rig {
            file: self.name.into(),
            lines: root.lines_of_keys(),
            nominal: Nominal {
                muscle: Muscle {
                    alpha_m2: UNREAD,
                    beta_m2: UNREAD,
                    gamma_n: UNREAD,
                    initial_length_m: UNREAD,
                },
                volume: None,
                load: Load::Prescribed,
                valve: None,
                gas: None,
            },
            assist: None,
            catalogue: self.catalogue.clone(),
            own_effects: self.own_effects.clone(),
            tolerances: Vec::new(),
            effects: Vec::new(),
            provenance: None,
        };
        for name in sections {
            match root.section(name)? {
                Some(section) => section.read_into(&mut rig)?,
                None if ["muscle", "load"].contains(&name) => {
                    return Err(root.bad(name, "this section, found none"));
                }
                None => {}
            }
        }
        rig.tolerances = tolerances(&root)?;
        rig.effects = effects(&root)?;
        let provenance = table.get("provenance").map(Provenance::read).transpose();
        rig.provenance = provenance.map_err(|expected| {
            root.bad(
                "provenance",
                format!("the table that `diagnose` writes, {expected}"),
            )
        })?;
        Ok(rig)
    }
}

impl Section<'_> {
    /// The lines of the root's sections and of their keys.
    fn lines_of_keys(&self) -> Vec<(String, usize)> {
        let mut lines = Vec::new();
        for (name, item) in self.table.iter() {
            if let (Some(section), true) = (self.section(name).ok().flatten(), item.is_table_like())
            {
                let keys = section.table.iter();
                lines.extend(
                    keys.filter_map(|(key, _)| Some((section.key(key), section.line(key)?))),
                );
                lines.extend(section.line.map(|line| (section.name.clone(), line)));
            }
        }
        lines.extend(self.line("effect").map(|line| ("effect".into(), line)));
        lines
    }

    /// Reads the numbers of this section into `rig`.
    fn read_into(&self, rig: &mut Rig) -> Result<(), BadInput> {
        self.add_part(rig)?;
        for key in keys::of_section(&self.name) {
            match (key.value)(rig) {
                Some(value) => *value = self.number(key)?,
                // The file may keep the weight while the muscle is on a test bench.
                None => drop(self.optional_number(key)?),
            }
        }
        Ok(())
    }

    /// Adds the part of the rig that this section describes, with numbers that are [`UNREAD`].
    fn add_part(&self, rig: &mut Rig) -> Result<(), BadInput> {
        let numbers: Vec<_> = keys::of_section(&self.name).map(|key| key.name).collect();
        let nominal = &mut rig.nominal;
        match self.name.as_str() {
            "load" => self.only(&[&["kind"], numbers.as_slice()].concat())?,
            _ => self.only(&numbers)?,
        }
        match self.name.as_str() {
            // A test bench whose pressure is measured needs no volume.
            "muscle" if self.has_volume() => {
                nominal.volume = Some(Volume {
                    d1_m3: UNREAD,
                    d2_m3: UNREAD,
                    d3_m3: UNREAD,
                });
            }
            "load" => nominal.load = self.load()?,
            "valve" => {
                nominal.valve = Some(Valve {
                    flow_gain_kg_per_pa_s: UNREAD,
                    supply_pressure: GaugePa(UNREAD),
                });
            }
            "gas" => {
                nominal.gas = Some(Gas {
                    ambient_temperature_k: UNREAD,
                    atmospheric_pressure: AbsolutePa(UNREAD),
                    heat_transfer_charging_w_per_m2_k: UNREAD,
                    heat_transfer_discharging_w_per_m2_k: UNREAD,
                });
            }
            "assist" => {
                rig.assist = Some(Assist {
                    gain: UNREAD,
                    input_stiffness_n_per_m: UNREAD,
                    lever_length_m: UNREAD,
                    pulley_diameter_m: UNREAD,
                });
            }
            _ => {}
        }
        Ok(())
    }

    fn has_volume(&self) -> bool {
        ["volume_d1_m3", "volume_d2_m3", "volume_d3_m3"]
            .iter()
            .any(|key| self.table.contains_key(key))
    }

    fn load(&self) -> Result<Load, BadInput> {
        match self.word("kind")? {
            "prescribed" => Ok(Load::Prescribed),
            "weight" => Ok(Load::Weight(Weight {
                mass_kg: UNREAD,
                viscous_damping_ns_per_m: UNREAD,
                coulomb_friction_n: UNREAD,
                static_friction_n: UNREAD,
            })),
            other => {
                let expected = format!("\"weight\" or \"prescribed\", found \"{other}\"");
                Err(self.bad("kind", expected))
            }
        }
    }
}

fn tolerances(root: &Section) -> Result<Vec<Tolerance>, BadInput> {
    let Some(sections) = root.section("tolerance")? else {
        return Ok(Vec::new());
    };
    sections.only(&keys::sections(|key| key.tolerance.is_some()))?;
    let mut tolerances = Vec::new();
    for (name, _) in sections.table.iter() {
        let Some(section) = sections.section(name)? else {
            continue;
        };
        let known: Vec<_> = keys::of_section(name).map(|key| key.name).collect();
        section.only(&known)?;
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

fn effects(root: &Section) -> Result<Vec<Effect>, BadInput> {
    let read = |table: &dyn TableLike, span: Option<Range<usize>>| {
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
    let effects = match root.table.get("effect") {
        None => Ok(Vec::new()),
        Some(Item::ArrayOfTables(tables)) => tables
            .iter()
            .map(|table| read(table, table.span()))
            .collect(),
        // TOML also allows `effect = [{ name = … }]`.
        Some(Item::Value(Value::Array(values))) => {
            let read = |value: &Value| match value {
                Value::InlineTable(table) => read(table, table.span()),
                other => Err(bad(other.type_name())),
            };
            values.iter().map(read).collect()
        }
        Some(other) => Err(bad(kind_of(other))),
    };
    once_each(effects?)
}

/// The effects, each once. Two of one kind add up if their values differ (`diagnose` finds a leak
/// beside that of the rig); the same again is a slip.
fn once_each(effects: Vec<(Effect, BadInput)>) -> Result<Vec<Effect>, BadInput> {
    let mut once: Vec<(Effect, Option<usize>)> = Vec::new();
    for (effect, place) in effects {
        let is_same = |(other, _): &&(Effect, _)| {
            (other.kind.name, other.form.name) == (effect.kind.name, effect.form.name)
                && other.values == effect.values
        };
        if let Some((_, first)) = once.iter().find(is_same) {
            let line = first.map_or_else(String::new, |line| format!(" of line {line}"));
            let expected = format!(
                "each effect once, found `{}`{line} again with the same values",
                effect.kind.name
            );
            return Err(BadInput { expected, ..place });
        }
        once.push((effect, place.line));
    }
    Ok(once.into_iter().map(|(effect, _)| effect).collect())
}

/// An effect, and the place of its name.
fn effect(section: &Section) -> Result<(Effect, BadInput), BadInput> {
    let name = section.word("name")?;
    let catalogue = &section.file.catalogue;
    let Some(kind) = catalogue.find(name) else {
        let known: Vec<_> = catalogue.kinds().map(|kind| kind.name).collect();
        return Err(section.bad("name", one_of(&known, name)));
    };
    let form = match section.table.contains_key("form") {
        false => &kind.forms[0],
        true => {
            let name = section.word("form")?;
            kind.form(name).ok_or_else(|| {
                let known: Vec<_> = kind.forms.iter().map(|form| form.name).collect();
                section.bad("form", one_of(&known, name))
            })?
        }
    };
    let mut known = vec!["name", "form"];
    known.extend(form.parameters.iter().map(|parameter| parameter.name));
    let mut errors: Vec<_> = section.unknown(&known).collect();
    let mut values = Vec::new();
    for parameter in form.parameters {
        match section.optional(parameter.name, parameter.min, parameter.max) {
            Ok(Some(value)) => values.push(value),
            Ok(None) => {
                let expected = format!("a number [{}], found no such key", parameter.unit);
                errors.push(section.bad(parameter.name, expected));
            }
            Err(error) => errors.push(error),
        }
    }
    match errors.into_iter().reduce(BadInput::and) {
        Some(error) => Err(error),
        None => Ok((Effect { kind, form, values }, section.bad("name", ""))),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

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
        let other = leak.replace('4', "5");
        let rig = parse(&[leak, &other].join("\n")).expect("a rig");
        assert_eq!(rig.effects.len(), 2);
        assert_eq!(rig.effects[1].values, [5e-9]);
        let error = parse(&[leak, &other, leak].join("\n")).expect_err("the same again");
        let line = rig.bad("effect", "").line.expect("its line");
        let says = format!(
            "rig.toml:{}: key `effect.name`: expected each effect once, found `leak` of line {} \
             again with the same values",
            line + 3,
            line + 1
        );
        assert_eq!(error.to_string(), says);
        let error = parse(&[leak, "{ name = \"leek\" }"].join("\n")).expect_err("no such effect");
        let line = |rig: &Rig| rig.bad("effect", "").line;
        assert_eq!(error.line, line(&rig).map(|line| line + 2));
        assert_eq!(error.place.as_deref(), Some("key `effect.name`"));
        let error = parse("4e-9").expect_err("no section");
        assert!(error.expected.ends_with("found float"), "{error}");
    }

    #[test]
    fn the_reference_file_holds_the_reference_values_of_the_plant() {
        assert_eq!(Rig::reference().nominal, Nominal::REFERENCE);
    }

    #[test]
    fn a_prescribed_load_keeps_the_range_check_of_the_weight() {
        let text = Rig::REFERENCE_TOML.replace("\"weight\"", "\"prescribed\"");
        let rig = Rig::parse("rig.toml", &text).expect("a rig");
        assert_eq!(rig.nominal.load, Load::Prescribed);
        let text = text.replace("mass_kg = 12.0", "mass_kg = -12.0");
        let error = Rig::parse("rig.toml", &text).expect_err("a negative mass");
        assert_eq!(error.place.as_deref(), Some("key `load.mass_kg`"));
    }
}
