//! `hil-sim effects`.

use super::{Failure, print, print_json};
use hil_sim::error::{BadInput, one_of};
use hil_sim::report::{Report, Section, Table};
use hil_sim::rig::effect_toml;
use muscle_plant::effects::{Catalogue, CompensationMethod, Effect, EffectKind, Form, Parameter};
use serde::Serialize;

/// List the effects that a rig may have, or show one with the lines to paste into a rig file
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  hil-sim effects
  hil-sim effects leak
  hil-sim effects --json")]
pub struct Args {
    /// The effect to show; all are listed if omitted
    #[arg(value_name = "NAME")]
    name: Option<String>,
    /// Print what the effects declare as JSON instead of text
    #[arg(long)]
    json: bool,
}

#[derive(Serialize)]
struct KindSummary {
    name: &'static str,
    subsystem: &'static str,
    signature: &'static str,
    test_signal: &'static str,
    compensation: String,
    forms: Vec<FormSummary>,
}

#[derive(Serialize)]
struct FormSummary {
    name: &'static str,
    source: &'static str,
    keys: Vec<KeySummary>,
    toml: String,
}

#[derive(Serialize)]
struct KeySummary {
    key: &'static str,
    unit: &'static str,
    min: f64,
    max: f64,
    typical: f64,
}

impl KindSummary {
    fn new(kind: &'static EffectKind) -> KindSummary {
        let key = |parameter: &Parameter| KeySummary {
            key: parameter.name,
            unit: parameter.unit,
            min: parameter.min,
            max: parameter.max,
            typical: parameter.typical,
        };
        let form = |form: &'static Form| FormSummary {
            name: form.name,
            source: form.source,
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

    fn report(&self) -> Report {
        let mut verdict = vec![
            format!("Subsystem: {}", self.subsystem),
            format!("Signature: {}", self.signature),
            format!("Test signal: {}", self.test_signal),
            format!("Compensation: {}", self.compensation),
        ];
        let sources = self.forms.iter();
        verdict.extend(sources.map(|form| format!("Form {}: {}", form.name, form.source)));
        Report {
            title: self.name.into(),
            verdict,
            sections: self.forms.iter().map(FormSummary::section).collect(),
            repeat: Vec::new(),
        }
    }
}

impl FormSummary {
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

fn list(kinds: &[KindSummary]) -> Report {
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

/// Runs the command with the effects of `catalogue`.
pub fn run(args: &Args, catalogue: &Catalogue) -> Result<(), Failure> {
    let Some(name) = &args.name else {
        let kinds: Vec<_> = catalogue.kinds().map(KindSummary::new).collect();
        if args.json {
            return Ok(print_json(&kinds)?);
        }
        return Ok(print(&list(&kinds).to_text())?);
    };
    let kind = catalogue.find(name).ok_or_else(|| {
        let known: Vec<_> = catalogue.kinds().map(|kind| kind.name).collect();
        BadInput::file("effects", one_of(&known, name))
    })?;
    let kind = KindSummary::new(kind);
    if args.json {
        return Ok(print_json(&kind)?);
    }
    let tomls = kind.forms.iter().map(|form| form.toml.as_str());
    let toml = tomls.collect::<Vec<_>>().join("\n");
    let text = kind.report().to_text();
    Ok(print(&format!(
        "{text}\nFor a rig file, one of:\n\n{toml}"
    ))?)
}
