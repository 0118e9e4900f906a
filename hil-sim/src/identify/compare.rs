//! Two diagnoses beside each other.

use super::gap::SIGNALS;
use super::report::quantity;
use crate::error::{BadInput, significant};
use crate::input::read_text;
use crate::report::{Report, Section, Table};
use crate::rig::{Provenance, Rig};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// What a diagnosis and its fitted rig are called in their folder.
const DIAGNOSIS: &str = "diagnosis.json";
const FITTED: &str = "rig.fitted.toml";
/// Versions of `diagnosis.json` that are read.
const SCHEMAS: std::ops::RangeInclusive<u32> = 1..=2;
/// How the two are called.
const NAMES: [&str; 2] = ["A", "B"];

/// A parameter as a diagnosis estimates it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(expecting = "an object with value, ci95 and unit")]
pub struct Estimate {
    /// Its value, in `unit`.
    pub value: f64,
    /// Its 95 % interval.
    pub ci95: [f64; 2],
    /// Its unit.
    pub unit: String,
}

impl Estimate {
    fn overlaps(&self, other: &Estimate) -> bool {
        self.ci95[0] <= other.ci95[1] && other.ci95[0] <= self.ci95[1]
    }

    fn words(&self) -> String {
        let number = |value| quantity(value, &self.unit);
        let [low, high] = self.ci95.map(number);
        format!("{} ({low} to {high})", number(self.value))
    }
}

/// A named effect.
#[derive(Clone, Debug, Deserialize)]
#[serde(expecting = "an object with name and parameters")]
struct Named {
    name: String,
    #[serde(default)]
    alternatives: Vec<String>,
    parameters: BTreeMap<String, Estimate>,
    probability: Option<f64>,
}

/// A signal's gap on the validation records, root mean square, in the column's unit.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(expecting = "an object with before, after and noise")]
pub struct GapOf {
    /// With the nominal rig.
    pub before: f64,
    /// With the fitted rig.
    pub after: f64,
    /// The sensor's noise.
    pub noise: f64,
}

/// What is read of a `diagnosis.json`.
#[derive(Clone, Debug, Deserialize)]
#[serde(expecting = "an object with schema, verdict, effects and gap")]
struct Written {
    schema: u32,
    verdict: String,
    effects: Vec<Named>,
    gap: BTreeMap<String, GapOf>,
}

/// A diagnosis that was written to a folder.
#[derive(Debug)]
pub struct Diagnosed {
    file: PathBuf,
    written: Written,
    /// Of the fitted rig beside it, if it is there.
    provenance: Option<Provenance>,
}

impl Diagnosed {
    /// Reads the diagnosis at `path`: a folder, or its `diagnosis.json`.
    ///
    /// # Errors
    /// The file cannot be read or is no diagnosis, or the fitted rig beside it is no rig.
    pub fn read(path: &Path) -> Result<Diagnosed, BadInput> {
        let file = if path.is_dir() {
            path.join(DIAGNOSIS)
        } else {
            path.to_path_buf()
        };
        let name = file.display().to_string();
        let expected = "a diagnosis (what `hil-sim diagnose --out` wrote)";
        let text = read_text(&file, expected)?;
        let written: Written = serde_json::from_str(&text).map_err(|error| BadInput {
            line: Some(error.line()).filter(|line| *line > 0),
            ..BadInput::file(&name, format!("{expected}, {error}"))
        })?;
        if !SCHEMAS.contains(&written.schema) {
            let [first, last] = [SCHEMAS.start(), SCHEMAS.end()];
            let expected = format!("schema {first} or {last}, found {}", written.schema);
            return Err(BadInput::file(name, expected));
        }
        let fitted = file.with_file_name(FITTED);
        let provenance = if fitted.is_file() {
            Rig::read(&fitted)?.provenance
        } else {
            None
        };
        Ok(Diagnosed {
            file,
            written,
            provenance,
        })
    }

    /// The file that was read.
    pub fn file(&self) -> &Path {
        &self.file
    }

    fn effect(&self, name: &str) -> Option<&Named> {
        self.written.effects.iter().find(|named| named.name == name)
    }

    /// The named effects, each with what the records cannot tell from it.
    fn names(&self) -> Vec<String> {
        let name = |named: &Named| {
            let alternatives = named.alternatives.iter().map(String::as_str);
            let names = std::iter::once(named.name.as_str()).chain(alternatives);
            names.collect::<Vec<_>>().join(" or ")
        };
        let mut names: Vec<String> = self.written.effects.iter().map(name).collect();
        names.sort();
        names
    }

    fn verdict(&self) -> String {
        let names = self.names();
        let verdict = &self.written.verdict;
        if names.is_empty() {
            verdict.clone()
        } else {
            format!("{verdict} ({})", names.join(" and "))
        }
    }

    fn validated_with(&self) -> Option<Vec<&str>> {
        let records = self.provenance.as_ref()?.records.iter();
        let validated = records.filter(|record| record.used_to == "validate");
        let mut hashes: Vec<&str> = validated.map(|r| &r.source.sha256[..]).collect();
        hashes.sort_unstable();
        Some(hashes)
    }
}

/// A parameter of an effect in both diagnoses.
#[derive(Debug, Serialize)]
pub struct ComparedParameter {
    /// Its estimates; none where the effect is not named.
    pub estimates: [Option<Estimate>; 2],
    /// Whether the intervals overlap, if there are two.
    pub overlap: Option<bool>,
}

/// An effect that at least one of both diagnoses names.
#[derive(Debug, Serialize)]
pub struct ComparedEffect {
    /// Its name.
    pub name: String,
    /// Which of both name it.
    pub named: [bool; 2],
    /// Its posterior probability, if the diagnosis has one.
    pub probability: [Option<f64>; 2],
    /// Its parameters.
    pub parameters: BTreeMap<String, ComparedParameter>,
}

/// Two diagnoses beside each other.
#[derive(Debug, Serialize)]
pub struct Comparison {
    /// The files.
    pub files: [PathBuf; 2],
    /// The verdicts.
    pub verdicts: [String; 2],
    /// The effects that either names.
    pub effects: Vec<ComparedEffect>,
    /// The gaps by signal, the largest above its noise first.
    #[serde(serialize_with = "as_object")]
    pub gap: Vec<(String, [Option<GapOf>; 2])>,
    /// Whether both were validated with the same records, if that is known.
    pub same_validation_records: Option<bool>,
    #[serde(skip)]
    words: [String; 2],
    #[serde(skip)]
    origins: [String; 2],
}

fn as_object<S: serde::Serializer>(
    gaps: &[(String, [Option<GapOf>; 2])],
    serializer: S,
) -> Result<S::Ok, S::Error> {
    serializer.collect_map(gaps.iter().map(|(signal, gaps)| (signal, gaps)))
}

/// Compares two diagnoses.
pub fn compare(both: &[Diagnosed; 2]) -> Comparison {
    let each = both.each_ref();
    let mut names: Vec<&str> = Vec::new();
    for named in each.iter().flat_map(|one| &one.written.effects) {
        if !names.contains(&&named.name[..]) {
            names.push(&named.name);
        }
    }
    let effect = |name: &str| {
        let named = each.map(|one| one.effect(name));
        let keys = named.iter().flatten().flat_map(|n| n.parameters.keys());
        let parameter = |key: &String| {
            let estimates = named.map(|n| n?.parameters.get(key).cloned());
            let overlap = match &estimates {
                [Some(one), Some(other)] => Some(one.overlaps(other)),
                _ => None,
            };
            (key.clone(), ComparedParameter { estimates, overlap })
        };
        ComparedEffect {
            name: name.into(),
            named: named.map(|n| n.is_some()),
            probability: named.map(|n| n?.probability),
            parameters: keys.map(parameter).collect(),
        }
    };
    let signals: std::collections::BTreeSet<&String> =
        each.iter().flat_map(|one| one.written.gap.keys()).collect();
    let gaps_of = |signal: &String| each.map(|one| one.written.gap.get(signal).copied());
    let mut gap: Vec<_> = signals
        .into_iter()
        .map(|s| (s.clone(), gaps_of(s)))
        .collect();
    let above_noise = |gaps: &[Option<GapOf>; 2]| {
        let above = gaps.iter().flatten().map(|gap| gap.after / gap.noise);
        above.fold(0.0, f64::max)
    };
    gap.sort_by(|(_, one), (_, other)| above_noise(other).total_cmp(&above_noise(one)));
    let [a, b] = each.map(Diagnosed::validated_with);
    let origin = |one: &Diagnosed| match &one.provenance {
        Some(from) => format!("{} {}, {}", from.tool, from.version, from.date),
        None => "–".into(),
    };
    Comparison {
        files: each.map(|one| one.file.clone()),
        verdicts: each.map(|one| one.written.verdict.clone()),
        effects: names.into_iter().map(effect).collect(),
        gap,
        same_validation_records: a.zip(b).map(|(a, b)| a == b),
        words: each.map(Diagnosed::verdict),
        origins: each.map(origin),
    }
}

/// Name, and a gap in the unit of reports.
fn said(signal: &str, value: f64) -> (String, String) {
    match SIGNALS.iter().find(|known| known.0 == signal) {
        Some((_, name, unit, factor)) => (
            (*name).into(),
            format!("{} {unit}", significant(factor * value)),
        ),
        None => (signal.into(), significant(value)),
    }
}

impl Comparison {
    /// Of which signals the fitted rig of A or B is nearer to the validation records.
    fn nearer(&self) -> Vec<String> {
        let words = self.gap.iter().filter_map(|(signal, gaps)| {
            let [Some(a), Some(b)] = gaps else {
                return None;
            };
            let (near, [better, worse]) = if a.after <= b.after {
                ("A", [a.after, b.after])
            } else {
                ("B", [b.after, a.after])
            };
            let [(name, better), (_, worse)] = [better, worse].map(|gap| said(signal, gap));
            Some(if better == worse {
                format!("both miss {name} by {better} RMS")
            } else {
                format!("{near} is nearer in {name} ({better} RMS against {worse})")
            })
        });
        words.collect()
    }

    fn sentences(&self) -> Vec<String> {
        let [a, b] = &self.words;
        let mut said = vec![if a == b {
            format!("Both diagnoses say {a}.")
        } else {
            format!("The diagnoses differ: A says {a}, B says {b}.")
        }];
        for effect in &self.effects {
            let apart = effect.parameters.iter();
            let apart = apart.filter(|(_, parameter)| parameter.overlap == Some(false));
            said.extend(apart.map(|(key, _)| {
                let name = &effect.name;
                format!("The intervals of {key} of {name} do not overlap.")
            }));
        }
        let nearer = self.nearer();
        if !nearer.is_empty() {
            let nearer = nearer.join("; ");
            said.push(format!("On the validation records of each: {nearer}."));
        }
        match self.same_validation_records {
            Some(true) => {}
            Some(false) => said.push(
                "Note: the validation records are not the same, so that the gaps do not compare \
                 the rigs."
                    .into(),
            ),
            None => said.push(format!(
                "Note: whether the validation records are the same is not known, as there is no \
                 {FITTED} with a [provenance] table beside each."
            )),
        }
        said
    }

    fn effect_table(&self) -> Table {
        let words = |estimate: &Option<Estimate>| match estimate {
            Some(estimate) => estimate.words(),
            None => "not named".into(),
        };
        let mut rows = Vec::new();
        for effect in &self.effects {
            if effect.probability.iter().any(Option::is_some) {
                let [a, b] = effect.probability.map(|known| match known {
                    Some(probability) => format!("{probability:.3}"),
                    None => "–".into(),
                });
                rows.push(vec![
                    effect.name.clone(),
                    "probability".into(),
                    a,
                    b,
                    "–".into(),
                ]);
            }
            for (key, parameter) in &effect.parameters {
                let [a, b] = parameter.estimates.each_ref().map(words);
                let overlap = match parameter.overlap {
                    Some(true) => "overlap",
                    Some(false) => "apart",
                    None => "–",
                };
                rows.push(vec![effect.name.clone(), key.clone(), a, b, overlap.into()]);
            }
        }
        let columns = ["effect", "parameter", "A", "B", "intervals"];
        Table {
            caption: "Named effects, with 95 % intervals".into(),
            columns: columns.map(String::from).to_vec(),
            rows,
        }
    }

    fn gap_table(&self) -> Table {
        let row = |(signal, gaps): &(String, [Option<GapOf>; 2])| {
            let mut cells = vec![said(signal, 0.0).0];
            for part in [|g: GapOf| g.before, |g: GapOf| g.after, |g: GapOf| g.noise] {
                cells.extend(gaps.map(|gap| match gap {
                    Some(gap) => said(signal, part(gap)).1,
                    None => "not compared".into(),
                }));
            }
            cells
        };
        let parts = ["nominal rig", "fitted rig", "noise"];
        let columns = parts
            .iter()
            .flat_map(|part| NAMES.map(|name| format!("{part} {name}")));
        Table {
            caption: "Root mean square of simulated − measured over the validation records of \
                      each, the largest above its noise first"
                .into(),
            columns: std::iter::once("signal".to_owned())
                .chain(columns)
                .collect(),
            rows: self.gap.iter().map(row).collect(),
        }
    }

    /// The comparison as a report.
    pub fn report(&self) -> Report {
        let row = |place: usize| {
            vec![
                NAMES[place].into(),
                self.files[place].display().to_string(),
                self.words[place].clone(),
                self.origins[place].clone(),
            ]
        };
        let section = |heading: &str, table: Table| Section {
            heading: heading.into(),
            tables: vec![table],
            ..Section::default()
        };
        let columns = ["", "diagnosis", "verdict", "fitted by"];
        let both = Table {
            caption: "The diagnoses".into(),
            columns: columns.map(String::from).to_vec(),
            rows: vec![row(0), row(1)],
        };
        let mut sections = vec![section("Verdicts", both)];
        if !self.effects.is_empty() {
            sections.push(section("Effects", self.effect_table()));
        }
        sections.push(section("The gap", self.gap_table()));
        Report {
            title: "Two diagnoses".into(),
            verdict: self.sentences(),
            sections,
            repeat: Vec::new(),
        }
    }
}
