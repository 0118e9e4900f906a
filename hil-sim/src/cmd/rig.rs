//! `hil-sim rig`.

use super::{Failure, between, length_m, this_command};
use hil_sim::datasheet::muscle;
use hil_sim::datasheet::report::report;
use hil_sim::datasheet::rig::DataSheets;
use hil_sim::datasheet::valve::ValveSheet;
use hil_sim::datasheet::volume::{self, Braid};
use hil_sim::error::BadInput;
use hil_sim::output::{same_file, write_atomically};
use hil_sim::rig::{DefaultTolerance, Key, Provenance, Rig, default_tolerances, uncalibrated};
use std::path::{Path, PathBuf};

/// Create and check rig files
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  hil-sim rig new my-rig.toml
  hil-sim rig check my-rig.toml")]
pub struct Args {
    #[command(subcommand)]
    command: Command,
}

#[derive(clap::Subcommand)]
enum Command {
    /// Write the paper's rig with comments, as a template, or a rig from data sheets
    New(New),
    /// Print tables of the tolerances that uncalibrated values have, for a rig that has none
    #[command(after_help = "Example:\n  hil-sim rig tolerances my-rig.toml >> my-rig.toml")]
    Tolerances {
        /// The file to read
        path: PathBuf,
        /// Print them as JSON instead of TOML
        #[arg(long)]
        json: bool,
    },
    /// Check a rig file and report its errors
    #[command(after_help = "Example:\n  hil-sim rig check my-rig.toml")]
    Check {
        /// The file to read
        path: PathBuf,
        /// Print the effects of the rig as JSON instead of text
        #[arg(long)]
        json: bool,
    },
}

/// Write the paper's rig with comments, as a template, or a rig from data sheets
///
/// The muscle's table is a CSV file with the columns contraction (or contraction_percent),
/// pressure_bar (or _pa, _kpa, _mpa, _psi; gauge) and force_n, a row for each point that is read
/// off a catalogue's diagram or measured. Eq 1 is fitted to it; its tolerances are those of the fit
/// and, unless the muscle itself was measured, those of muscles of one type.
#[derive(clap::Args)]
#[command(group(clap::ArgGroup::new("sheet").args(["muscle", "valve"]).multiple(true)))]
#[command(after_help = "\
Examples:
  hil-sim rig new my-rig.toml
  hil-sim rig new my-rig.toml --muscle table.csv --length 0.3 --diameter 0.02 --braid-angle 25 \\
      --valve Q=700 --report fit.html
  hil-sim rig new my-rig.toml --valve C=2.7,b=0.3")]
struct New {
    /// The file to write
    #[arg(default_value = "rig.toml")]
    path: PathBuf,
    /// Overwrite an existing file
    #[arg(long)]
    force: bool,
    /// Table of the muscle's forces over contraction and pressure
    #[arg(long, value_name = "TABLE.csv", requires = "length")]
    muscle: Option<PathBuf>,
    /// The muscle's length at contraction 0 [m]
    #[arg(long, value_name = "M", requires = "muscle", value_parser = length_m(1e-3, 100.0))]
    length: Option<f64>,
    /// Diameter of the air in the muscle at contraction 0 [m], for its volume
    #[arg(long, value_name = "M", requires_all = ["muscle", "braid_angle"],
          value_parser = length_m(1e-4, 1.0))]
    diameter: Option<f64>,
    /// Angle between the braid's threads and the muscle's axis at contraction 0 [degrees]
    #[arg(long, value_name = "DEG", requires = "diameter", value_parser = between(1.0, 54.0))]
    braid_angle: Option<f64>,
    /// Table of measured volumes: contraction, and volume_ml (or _cm3, _l, _m3)
    #[arg(
        long,
        value_name = "TABLE.csv",
        requires = "muscle",
        conflicts_with = "diameter"
    )]
    volume: Option<PathBuf>,
    /// The tables were measured on this muscle, not read off a catalogue
    #[arg(long, requires = "muscle")]
    measured: bool,
    /// The valve as its data sheet has it: C= dm³/(s·bar), Kv= m³/h, Cv= US gal/min, or
    /// Q=[,from=,to=] l/min (ANR) between gauge pressures in bar, 6 and 5 if omitted; each with
    /// [,b=], 0.3 if omitted
    #[arg(long, value_name = "VALVE")]
    valve: Option<ValveSheet>,
    /// A report of the fit to write, with plots
    #[arg(long, value_name = "REPORT.html", requires = "sheet")]
    report: Option<PathBuf>,
    /// Print the values as JSON instead of text
    #[arg(long)]
    json: bool,
}

/// What the data sheets among the arguments say.
fn data_sheets(args: &New) -> Result<DataSheets, BadInput> {
    let mut sheets = DataSheets {
        measured: args.measured,
        valve: args.valve,
        ..DataSheets::default()
    };
    // clap requires the length with the table.
    let (Some(table), Some(length_m)) = (&args.muscle, args.length) else {
        return Ok(sheets);
    };
    let fit = muscle::read(table, length_m)?;
    if let (Some(diameter_m), Some(angle)) = (args.diameter, args.braid_angle) {
        let braid = Braid {
            length_m,
            diameter_m,
            angle_rad: angle.to_radians(),
        };
        let reached = fit.points().map(|at| at.contraction).fold(0.0, f64::max);
        let contraction_max = match reached > 0.0 {
            true => reached.min(braid.contraction_max()),
            false => braid.contraction_max(),
        };
        sheets.volume = braid
            .fitted(contraction_max)
            .map(|fit| (fit, "the braid's geometry".into()));
        sheets.braid = Some(braid);
    }
    if let Some(path) = &args.volume {
        sheets.volume = Some((volume::read(path)?, path.display().to_string()));
    }
    sheets.muscle = Some((fit, table.display().to_string()));
    Ok(sheets)
}

/// Refuses outputs that exist, or would overwrite an input or each other.
fn check_outputs(args: &New) -> Result<(), BadInput> {
    let bad =
        |path: &Path, expected: &str| Err(BadInput::file(path.display().to_string(), expected));
    if args.path.exists() && !args.force {
        return bad(&args.path, "no file here, or --force to overwrite it");
    }
    let report = args.report.as_ref();
    for output in [Some(&args.path), report].into_iter().flatten() {
        let inputs = [&args.muscle, &args.volume];
        if inputs
            .into_iter()
            .flatten()
            .any(|input| same_file(output, input))
        {
            return bad(output, "an output that is not an input too");
        }
    }
    match report {
        Some(report) if same_file(report, &args.path) => {
            bad(report, "a report beside the rig, not in its place")
        }
        _ => Ok(()),
    }
}

fn new(args: &New) -> Result<(), Failure> {
    check_outputs(args)?;
    let sheets = data_sheets(args)?;
    let (text, summary) = sheets.rig(&Rig::template())?;
    let path = args.path.display().to_string();
    super::accepted(Rig::parse(&path, &text).and_then(|rig| rig.check_units()))?;
    write_atomically(&args.path, text.as_bytes())?;
    let mut report = report(&sheets, &summary);
    report.repeat = vec![this_command()];
    if let Some(path) = &args.report {
        write_atomically(path, report.to_html().as_bytes())?;
        super::note(format_args!("written: {}", path.display()));
    }
    if args.json {
        super::print_json(&summary)?;
    } else if !summary.values.is_empty() {
        super::print(&report.to_text())?;
    }
    super::note(format_args!("written: {}", args.path.display()));
    Ok(())
}

/// A rig file without errors.
#[derive(serde::Serialize)]
struct Checked<'a> {
    path: &'a Path,
    effects: Vec<&'static str>,
    provenance: Option<&'a Provenance>,
}

/// The tolerance of a value that was not calibrated.
#[derive(serde::Serialize)]
struct Tolerance {
    section: &'static str,
    key: &'static str,
    relative_sigma: f64,
    source: &'static str,
}

fn tolerance((key, tolerance): (&'static Key, DefaultTolerance)) -> Tolerance {
    Tolerance {
        section: key.section,
        key: key.name,
        relative_sigma: tolerance.relative_sigma,
        source: tolerance.source,
    }
}

/// Where a fitted rig comes from, as the end of a sentence; empty for one that was not fitted.
fn fitted(rig: &Rig) -> String {
    let words = rig.provenance.as_ref().map(|from| {
        format!(
            ", fitted on {} by {} {} ({}) to {} records and validated with {}",
            from.date,
            from.tool,
            from.version,
            from.verdict,
            from.count("fit"),
            from.count("validate")
        )
    });
    words.unwrap_or_default()
}

/// Runs the command.
pub fn run(args: &Args) -> Result<(), Failure> {
    match &args.command {
        Command::New(args) => new(args)?,
        Command::Tolerances { path, json } => {
            let rig = super::read_rig(path)?;
            // Also if the tables are empty: TOML does not allow a second one of the same name.
            let table = Rig::read_text(path)?.parse::<toml_edit::DocumentMut>();
            if table.is_ok_and(|table| table.contains_key("tolerance")) {
                let expected = "a rig without [tolerance.*] tables, which it has (remove them)";
                return Err(rig.bad_file(expected).into());
            }
            if *json {
                let tolerances: Vec<_> = uncalibrated(&rig).map(tolerance).collect();
                super::print_json(&tolerances)?;
                return Ok(());
            }
            super::print(&format!("\n{}", default_tolerances(&rig)))?;
        }
        Command::Check { path, json } => {
            let rig = super::read_rig(path)?;
            if *json {
                let effects = rig.effects.iter().map(|effect| effect.kind.name);
                let effects = effects.collect();
                let provenance = rig.provenance.as_ref();
                super::print_json(&Checked {
                    path,
                    effects,
                    provenance,
                })?;
                return Ok(());
            }
            let effects = rig.effects.len();
            let (path, fitted) = (path.display(), fitted(&rig));
            let plural = if effects == 1 { "" } else { "s" };
            super::print(&format!(
                "{path}: a rig, {effects} effect{plural}{fitted}\n"
            ))?;
        }
    }
    Ok(())
}
