//! `hil-sim effects`.

use super::{Failure, print, print_json, this_command};
use hil_sim::effect_plots;
use hil_sim::error::{BadInput, one_of};
use hil_sim::output::write_atomically;
use hil_sim::report::{Report, Section, Table};
use hil_sim::rig::effect_toml;
use muscle_plant::effects::{Catalogue, CompensationMethod, Effect, EffectKind, Form, Parameter};
use serde::Serialize;
use std::fmt::Write;
use std::path::PathBuf;

/// The symbols of the equations, for the help and the page.
macro_rules! symbols {
    () => {
        "\
Symbols: P pressure (gauge), P_abs the same absolute, P_r its reference, P_s the supply,
ε contraction, F force, G mass flow through the valve towards the muscle, V volume, θ temperature of
the air in the muscle, θ_a that of the surroundings, θ_w that of the muscle's wall, h coefficient of
heat transfer from the wall to the air, R_air gas constant of air, t time, v speed of the load,
L initial length, K_G flow gain of the valve. Other names in words are keys of the effect.
"
    };
}

/// List the effects that a rig may have, or show one with the lines to paste into a rig file
#[derive(clap::Args)]
#[command(after_help = concat!(symbols!(), "
Examples:
  hil-sim effects
  hil-sim effects leak
  hil-sim effects leak --report leak.html
  hil-sim effects --json"))]
pub struct Args {
    /// The effect to show; all are listed if omitted
    #[arg(value_name = "NAME")]
    name: Option<String>,
    /// A report to write, with plots of the effect's signature on the paper's rig
    #[arg(long, value_name = "REPORT.html", requires = "name")]
    report: Option<PathBuf>,
    /// Print what the effects declare as JSON instead of text
    #[arg(long)]
    json: bool,
    /// Print all of it as the page docs/effects.md
    #[arg(long, conflicts_with_all = ["name", "json"])]
    markdown: bool,
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
    equation: &'static str,
    source: &'static str,
    leaves_out: &'static str,
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

    fn report(&self) -> Report {
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

/// All effects as a page in Markdown.
fn markdown(kinds: &[KindSummary]) -> String {
    let mut page = String::from(PAGE_HEAD);
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

const PAGE_HEAD: &str = concat!(
    "\
# Effects that a rig may have

Printed by `hil-sim effects --markdown` from what each effect declares in
`muscle-plant/src/effects`; a test keeps them the same. `hil-sim effects NAME --report
signature.html` plots the signature on the paper's rig. The first form of an effect is the default.
Equations 1 to 9: [theory](theory.md).

",
    symbols!()
);

/// Runs the command with the effects of `catalogue`.
pub fn run(args: &Args, catalogue: &Catalogue) -> Result<(), Failure> {
    let Some(name) = &args.name else {
        let kinds: Vec<_> = catalogue.kinds().map(KindSummary::new).collect();
        if args.json {
            return Ok(print_json(&kinds)?);
        }
        if args.markdown {
            return Ok(print(&markdown(&kinds))?);
        }
        return Ok(print(&list(&kinds).to_text())?);
    };
    let kind = catalogue.find(name).ok_or_else(|| {
        let known: Vec<_> = catalogue.kinds().map(|kind| kind.name).collect();
        BadInput::file("effects", one_of(&known, name))
    })?;
    let summary = KindSummary::new(kind);
    if let Some(path) = &args.report {
        let mut report = summary.report();
        report.sections.push(Section {
            heading: "Signature".into(),
            plots: effect_plots::plots(kind)?,
            ..Section::default()
        });
        report.repeat = vec![this_command()];
        write_atomically(path, report.to_html().as_bytes())?;
        super::note(format_args!("report: {}", path.display()));
    }
    let kind = summary;
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
