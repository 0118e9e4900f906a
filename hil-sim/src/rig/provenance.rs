//! Where a fitted rig comes from: its table `[provenance]`, which no simulation reads.

use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use toml_edit::{Array, ArrayOfTables, Datetime, DocumentMut, InlineTable, Item, Table, value};

/// First words of the comments at the top of a fitted rig.
pub const FITTED_BY: &str = "# Fitted by hil-sim ";
/// The table's key.
const KEY: &str = "provenance";

/// A file and what it contained.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct FileHash {
    /// Its name, without its folder.
    pub file: String,
    /// SHA-256 of its bytes, hexadecimal.
    pub sha256: String,
}

/// A record of a diagnosis.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct UsedRecord {
    /// Its file.
    #[serde(flatten)]
    pub source: FileHash,
    /// `fit` or `validate`.
    pub used_to: String,
}

/// An effect as a diagnosis named it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct FoundEffect {
    /// Its name.
    pub name: String,
    /// The form of its equations.
    pub form: String,
    /// Probability that it, or one of its alternatives, is present.
    pub probability: f64,
    /// Effects that the records cannot tell from it.
    #[serde(default)]
    pub alternatives: Vec<String>,
    /// 95 % interval of each parameter, in the unit of its key.
    #[serde(default)]
    pub ci95: BTreeMap<String, [f64; 2]>,
}

/// Where a fitted rig comes from.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Provenance {
    /// The program.
    pub tool: String,
    /// Its version.
    pub version: String,
    /// When it was fitted, UTC.
    pub date: Datetime,
    /// The verdict of the diagnosis.
    pub verdict: String,
    /// The nominal rig.
    pub nominal_rig: FileHash,
    /// The records.
    #[serde(default, rename = "record")]
    pub records: Vec<UsedRecord>,
    /// The effects that the diagnosis added.
    #[serde(default, rename = "effect")]
    pub effects: Vec<FoundEffect>,
}

impl Provenance {
    /// Reads the table.
    pub(super) fn read(item: &Item) -> Result<Provenance, String> {
        let mut document = DocumentMut::new();
        document.insert(KEY, item.clone());
        #[derive(Deserialize)]
        struct Rig {
            provenance: Provenance,
        }
        let read: Result<Rig, _> = toml_edit::de::from_document(document);
        let read = read.map_err(|error| error.message().replace('\n', " "))?;
        Ok(read.provenance)
    }

    /// How many records were used to `fit` or to `validate`.
    pub fn count(&self, used_to: &str) -> usize {
        let used = self.records.iter();
        used.filter(|record| record.used_to == used_to).count()
    }

    /// The comments at the top of a rig file and the table at its end around `rig_toml`, without
    /// those of an earlier fit.
    ///
    /// # Errors
    /// The text is not TOML.
    pub fn around(&self, rig_toml: &str) -> Result<String, toml_edit::TomlError> {
        let mut document: DocumentMut = without_comments(rig_toml).parse()?;
        if let Some(Item::Table(earlier)) = document.remove(KEY) {
            // What stands above the table is of the user.
            let above = earlier.decor().prefix().and_then(|prefix| prefix.as_str());
            let below = document.trailing().as_str().unwrap_or_default();
            let both = above.unwrap_or_default().to_owned() + below;
            document.set_trailing(both);
        }
        Ok(format!(
            "{}\n{}\n{}",
            self.comments(),
            document.to_string().trim_end_matches('\n').to_owned() + "\n",
            self.table()
        ))
    }

    fn comments(&self) -> String {
        let mut text = format!(
            "{FITTED_BY}{} diagnose, {}. Verdict: {}.\n",
            self.version, self.date, self.verdict
        );
        for effect in &self.effects {
            let (name, form) = (&effect.name, &effect.form);
            text += &format!("# {name} ({form}): probability {:.3}\n", effect.probability);
            for (key, [low, high]) in &effect.ci95 {
                text += &format!("# {name} ({form}): {key} from {low:.3e} to {high:.3e} (95 %)\n");
            }
        }
        let used_to = |group: &'static str| {
            let records = self.records.iter();
            let of_group = records.filter(move |record| record.used_to == group);
            of_group.map(|record| &record.source).collect::<Vec<_>>()
        };
        for (group, files) in [
            ("nominal rig", vec![&self.nominal_rig]),
            ("fitted records", used_to("fit")),
            ("validation records", used_to("validate")),
        ] {
            text += &format!("# SHA-256 of the {group}:\n");
            for FileHash { file, sha256 } in files {
                text += &format!("# {sha256}  {}\n", one_line(file));
            }
        }
        text
    }

    fn table(&self) -> DocumentMut {
        let mut table = Table::new();
        table["tool"] = value(&self.tool);
        table["version"] = value(&self.version);
        table["date"] = value(self.date);
        table["verdict"] = value(&self.verdict);
        let mut nominal = InlineTable::new();
        nominal.insert("file", self.nominal_rig.file.as_str().into());
        nominal.insert("sha256", self.nominal_rig.sha256.as_str().into());
        table["nominal_rig"] = value(nominal);
        let mut records = ArrayOfTables::new();
        for UsedRecord { source, used_to } in &self.records {
            let mut record = Table::new();
            record["file"] = value(&source.file);
            record["sha256"] = value(&source.sha256);
            record["used_to"] = value(used_to);
            records.push(record);
        }
        table["record"] = Item::ArrayOfTables(records);
        let mut effects = ArrayOfTables::new();
        for found in &self.effects {
            let mut effect = Table::new();
            effect["name"] = value(&found.name);
            effect["form"] = value(&found.form);
            effect["probability"] = rounded(found.probability).into();
            effect["alternatives"] = value(Array::from_iter(&found.alternatives));
            let mut intervals = InlineTable::new();
            for (key, ends) in &found.ci95 {
                let ends = ends.map(rounded).into_iter().collect::<Array>();
                intervals.insert(key, ends.into());
            }
            effect["ci95"] = value(intervals);
            effects.push(effect);
        }
        table["effect"] = Item::ArrayOfTables(effects);
        let mut document = DocumentMut::new();
        document[KEY] = Item::Table(table);
        document
    }
}

/// A number with four significant digits, as TOML.
fn rounded(number: f64) -> toml_edit::Value {
    let text = format!("{number:.3e}");
    let short = text.parse().unwrap_or(number);
    super::edit::float_toml(short)
        .parse()
        .unwrap_or_else(|_| number.into())
}

/// A file name in a comment, which a line break would end.
fn one_line(name: &str) -> String {
    let escaped = name.chars().map(|character| {
        if character.is_control() {
            character.escape_default().collect()
        } else {
            String::from(character)
        }
    });
    escaped.collect()
}

/// `text` without the comments of an earlier fit at its top.
fn without_comments(text: &str) -> &str {
    if !text.starts_with(FITTED_BY) {
        return text;
    }
    // They end with an empty line.
    let (_, rest) = text.split_once("\n\n").unwrap_or(("", text));
    rest
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rig::Rig;

    fn file(name: &str, sha256: &str) -> FileHash {
        FileHash {
            file: name.into(),
            sha256: sha256.into(),
        }
    }

    fn sample() -> Provenance {
        let record = |name: &str, used_to: &str| UsedRecord {
            source: file(name, "e3b0"),
            used_to: used_to.into(),
        };
        Provenance {
            tool: "hil-sim".into(),
            version: "0.1.0".into(),
            date: "2026-01-02T03:04:05Z".parse().expect("a date"),
            verdict: "explained".into(),
            nominal_rig: file("rig.toml", "ba78"),
            records: vec![
                record("a.csv", "fit"),
                record("b\nmass_kg = \"0\"", "validate"),
            ],
            effects: vec![FoundEffect {
                name: "leak".into(),
                form: "linear".into(),
                probability: 0.976_54,
                alternatives: vec!["pressure-sensor-gain".into()],
                ci95: BTreeMap::from([("conductance_kg_per_pa_s".into(), [2.631_4e-10, 2.91e-10])]),
            }],
        }
    }

    /// The user's comments and values stay, also those behind the last value, and so does the rig.
    #[test]
    fn the_table_is_read_back_and_replaces_that_of_an_earlier_fit() {
        let user = format!("# Mine.\n\n{}# the end\n", Rig::REFERENCE_TOML);
        let once = sample().around(&user).expect("TOML");
        let rig = Rig::parse("rig.fitted.toml", &once).expect("a rig");
        assert_eq!(rig.nominal, Rig::reference().nominal);
        let read = rig.provenance.expect("a table");
        let mut expected = sample();
        // Of numbers four digits are written.
        expected.effects[0].probability = 0.9765;
        expected.effects[0].ci95 =
            BTreeMap::from([("conductance_kg_per_pa_s".into(), [2.631e-10, 2.91e-10])]);
        assert_eq!(read, expected);
        assert_eq!((read.count("fit"), read.count("validate")), (1, 1));
        assert!(once.contains(&user), "{once}");
        assert!(once.starts_with(FITTED_BY), "{once}");
        assert!(
            once.contains("# leak (linear): probability 0.977\n"),
            "{once}"
        );
        let later = Provenance {
            verdict: "consistent".into(),
            effects: Vec::new(),
            ..sample()
        };
        let twice = later.around(&once).expect("TOML");
        assert_eq!(twice, later.around(&user).expect("TOML"));
        assert_eq!(twice.matches(FITTED_BY).count(), 1);
    }

    /// An editor's rewriting of the rig keeps the table.
    #[test]
    fn a_rewritten_rig_keeps_the_table() {
        let once = sample().around(Rig::REFERENCE_TOML).expect("TOML");
        let rig = Rig::parse("rig.fitted.toml", &once).expect("a rig");
        assert_eq!(rig.rewritten(&once), Ok(once));
    }

    #[test]
    fn a_table_that_is_not_one_is_refused_with_its_line() {
        let text = Rig::REFERENCE_TOML.replace("schema = 1\n", "schema = 1\nprovenance = 3\n");
        let error = Rig::parse("rig.toml", &text).expect_err("no table");
        assert_eq!(error.place.as_deref(), Some("key `provenance`"));
        let line = text.lines().position(|line| line == "provenance = 3");
        assert_eq!(error.line, line.map(|line| line + 1));
        let once = sample().around(Rig::REFERENCE_TOML).expect("TOML");
        let wrong = once.replace("probability = 0.9765", "probability = \"much\"");
        assert_ne!(once, wrong);
        let error = Rig::parse("rig.toml", &wrong).expect_err("no number");
        assert!(error.expected.contains("much"), "{error}");
    }
}
