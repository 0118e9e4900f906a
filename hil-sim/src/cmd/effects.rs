//! `hil-sim effects`.

use super::{Failure, print, print_json, this_command};
use hil_sim::effect_page::{KindSummary, list, markdown};
use hil_sim::effect_plots;
use hil_sim::error::{BadInput, one_of};
use hil_sim::output::write_atomically;
use hil_sim::report::Section;
use muscle_plant::effects::Catalogue;
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
  hil-sim effects --rig rig.toml
  hil-sim effects --json"))]
pub struct Args {
    /// The effect to show; all are listed if omitted
    #[arg(value_name = "NAME")]
    name: Option<String>,
    /// A report to write, with plots of the effect's signature on the paper's rig
    #[arg(long, value_name = "REPORT.html", requires = "name")]
    report: Option<PathBuf>,
    /// A rig file, whose own effects are listed too
    #[arg(long, value_name = "RIG.toml", conflicts_with = "markdown")]
    rig: Option<PathBuf>,
    /// Print what the effects declare as JSON instead of text
    #[arg(long)]
    json: bool,
    /// Print all of it as the page docs/effects.md
    #[arg(long, conflicts_with_all = ["name", "json"])]
    markdown: bool,
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

/// Runs the command.
pub fn run(args: &Args) -> Result<(), Failure> {
    let catalogue = match &args.rig {
        Some(path) => super::read_rig(path)?.catalogue,
        None => Catalogue::standard(),
    };
    let Some(name) = &args.name else {
        let kinds: Vec<_> = catalogue.kinds().map(KindSummary::new).collect();
        if args.json {
            return Ok(print_json(&kinds)?);
        }
        if args.markdown {
            return Ok(print(&markdown(PAGE_HEAD, &kinds))?);
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
