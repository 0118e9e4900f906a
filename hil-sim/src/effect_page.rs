//! What the effects declare: as JSON, in words, and as the page docs/effects.md.

use crate::report::{Report, Section, Table};
use crate::rig::effect_toml;
use muscle_plant::effects::{CompensationMethod, Effect, EffectKind, Form, Parameter};
use serde::Serialize;
use std::fmt::Write;

/// An effect.
#[derive(Debug, Serialize)]
pub struct KindSummary {
    /// Its name.
    pub name: &'static str,
    /// The subsystem that it changes.
    pub subsystem: &'static str,
    /// What tells it from others.
    pub signature: &'static str,
    /// What shows it.
    pub test_signal: &'static str,
    /// How the controller compensates it.
    pub compensation: String,
    /// Its forms, the default first.
    pub forms: Vec<FormSummary>,
}

/// A form of an effect.
#[derive(Debug, Serialize)]
pub struct FormSummary {
    /// Its name.
    pub name: &'static str,
    /// Its equation.
    pub equation: &'static str,
    /// Where that comes from.
    pub source: &'static str,
    /// What it leaves out.
    pub leaves_out: &'static str,
    /// Its keys in a rig file.
    pub keys: Vec<KeySummary>,
    /// The lines for a rig file, with typical values.
    pub toml: String,
}

/// A key of a form in a rig file.
#[derive(Debug, Serialize)]
pub struct KeySummary {
    /// Its name.
    pub key: &'static str,
    /// Its unit.
    pub unit: &'static str,
    /// The least, the largest and a typical value.
    pub min: f64,
    /// See `min`.
    pub max: f64,
    /// See `min`.
    pub typical: f64,
}

impl KindSummary {
    /// What `kind` declares.
    pub fn new(kind: &'static EffectKind) -> KindSummary {
        let key = |parameter: &Parameter| KeySummary {
            key: parameter.name,
            unit: parameter.unit,
            min: parameter.min,
            max: parameter.max,
            typical: parameter.typical,
        };
        let form = |form: &'static Form| FormSummary {
            name: form.name,
            equation: form.equation,
            source: form.source,
            leaves_out: form.leaves_out,
            keys: form.parameters.iter().map(key).collect(),
            toml: effect_toml(&Effect::typical(kind, form)),
        };
        KindSummary {
            name: kind.name,
            subsystem: kind.subsystem.name(),
            signature: kind.signature,
            test_signal: kind.test_signal,
            compensation: compensation(&kind.compensation),
            forms: kind.forms.iter().map(form).collect(),
        }
    }

    /// It in words.
    pub fn report(&self) -> Report {
        let mut verdict = vec![
            format!("Signature: {}", self.signature),
            format!("Subsystem: {}", self.subsystem),
            format!("Test signal: {}", self.test_signal),
            format!("Compensation: {}", self.compensation),
        ];
        verdict.extend(self.forms.iter().flat_map(FormSummary::sentences));
        Report {
            title: self.name.into(),
            verdict,
            sections: self.forms.iter().map(FormSummary::section).collect(),
            repeat: Vec::new(),
        }
    }
}

impl FormSummary {
    /// Its equation, its source and what it leaves out.
    fn sentences(&self) -> [String; 3] {
        [
            format!("Form {}: {}", self.name, self.equation),
            format!("  Source: {}", self.source),
            format!("  Leaves out: {}.", self.leaves_out),
        ]
    }

    fn markdown(&self, page: &mut String) -> std::fmt::Result {
        let FormSummary {
            name,
            equation,
            source,
            leaves_out,
            ..
        } = self;
        let equation = equation.replace("; ", "\n    ");
        writeln!(page, "\n**{name}**\n\n    {equation}\n")?;
        writeln!(page, "{source} Leaves out {leaves_out}.")?;
        if !self.keys.is_empty() {
            writeln!(
                page,
                "\n| key | unit | from | to | typical |\n|---|---|---|---|---|"
            )?;
        }
        for key in &self.keys {
            let numbers = [key.min, key.max, key.typical].map(|value| format!("{value:?}"));
            let numbers = numbers.join(" | ");
            writeln!(page, "| `{}` | {} | {numbers} |", key.key, key.unit)?;
        }
        writeln!(page, "\n```toml\n{}```", self.toml)
    }

    fn section(&self) -> Section {
        let row = |key: &KeySummary| {
            let numbers = [key.min, key.max, key.typical].map(|value| format!("{value:?}"));
            [vec![key.key.into(), key.unit.into()], numbers.into()].concat()
        };
        Section {
            heading: format!("Form {}", self.name),
            tables: vec![Table {
                caption: String::new(),
                columns: ["key", "unit", "from", "to", "typical"]
                    .map(String::from)
                    .into(),
                rows: self.keys.iter().map(row).collect(),
            }],
            ..Section::default()
        }
    }
}

/// The part of the controller that compensates an effect, in words.
fn compensation(method: &CompensationMethod) -> String {
    match method {
        CompensationMethod::HysteresisLoop => "the hysteresis loop of the controller".into(),
        CompensationMethod::Friction(_) => "a force in the direction of motion".into(),
        CompensationMethod::Payload(_) => "a constant force".into(),
        CompensationMethod::ValveDeadZone(_) => "a step of the reference across it".into(),
        CompensationMethod::PressureSensorOffset(_) => "the zero of the pressure reading".into(),
        CompensationMethod::PressureSensorGain(_) => "the scale of the pressure reading".into(),
        CompensationMethod::Lag => "the lead of the reference".into(),
        CompensationMethod::Unavailable(reason) => format!("none: {reason}"),
    }
}

/// The effects in words.
pub fn list(kinds: &[KindSummary]) -> Report {
    let row = |kind: &KindSummary| {
        let forms: Vec<_> = kind.forms.iter().map(|form| form.name).collect();
        vec![kind.name.into(), kind.subsystem.into(), forms.join(", ")]
    };
    Report {
        title: "Effects that a rig may have".into(),
        sections: vec![Section {
            heading: "To show one: hil-sim effects NAME".into(),
            tables: vec![Table {
                caption: String::new(),
                columns: ["name", "subsystem", "forms, the first by default"]
                    .map(String::from)
                    .into(),
                rows: kinds.iter().map(row).collect(),
            }],
            ..Section::default()
        }],
        ..Report::default()
    }
}

/// All effects as a page in Markdown, below `head`.
pub fn markdown(head: &str, kinds: &[KindSummary]) -> String {
    let mut page = String::from(head);
    // Writing to a string cannot fail.
    let _ = write_effects(&mut page, kinds);
    page
}

fn write_effects(page: &mut String, kinds: &[KindSummary]) -> std::fmt::Result {
    for kind in kinds {
        let KindSummary {
            name,
            subsystem,
            signature,
            test_signal,
            compensation,
            forms,
        } = kind;
        writeln!(
            page,
            "\n## {name}\n\n| | |\n|---|---|\n| subsystem | {subsystem} |"
        )?;
        writeln!(
            page,
            "| signature | {signature} |\n| test signal | {test_signal} |"
        )?;
        writeln!(page, "| compensation | {compensation} |")?;
        for form in forms {
            form.markdown(page)?;
        }
    }
    Ok(())
}
