//! `hil-sim check`.

use super::Failure;
use hil_sim::record::Record;
use hil_sim::record::check::{Check, Finding, Sampling, Signal, Subsystem, check};
use hil_sim::report::{Report, Section, Table};
use muscle_plant::effects::Catalogue;
use serde::Serialize;
use std::path::PathBuf;

/// Check whether a record is suitable for a diagnosis: sampling, noise, faulty sensors, excitation
///
/// States also which subsystems can be diagnosed from it, and which effects it hardly shows.
///
/// An error makes `diagnose` refuse the record, a warning makes its result less certain. The exit
/// status is 0 in both cases.
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  hil-sim check measured.csv
  hil-sim check measured.csv --rig rig.toml --json")]
pub struct Args {
    /// The record
    #[arg(value_name = "REC.csv")]
    record: PathBuf,
    /// The measured rig, to check whether its load can be diagnosed
    #[arg(long, value_name = "RIG")]
    rig: Option<PathBuf>,
    /// Print a machine-readable summary instead of text
    #[arg(long)]
    json: bool,
}

#[derive(Serialize)]
struct Summary<'a> {
    sampling: &'a Sampling,
    signals: &'a [Signal],
    errors: &'a [Finding],
    warnings: &'a [Finding],
    blocks: &'a [Subsystem],
}

/// Runs the command.
pub fn run(args: &Args) -> Result<(), Failure> {
    let record = Record::read(&args.record)?;
    record.check_names()?;
    let rig = args.rig.as_deref().map(super::read_rig).transpose()?;
    let mut check = check(&record);
    let doubted = check.units(&record, rig.as_ref());
    match super::accepts() {
        true => check.warnings.extend(doubted),
        false => check.errors.extend(doubted),
    }
    let blocks = check.subsystems(&Catalogue::standard(), rig.as_ref());
    if args.json {
        super::print_json(&Summary {
            sampling: &check.sampling,
            signals: &check.signals,
            errors: &check.errors,
            warnings: &check.warnings,
            blocks: &blocks,
        })?;
    } else {
        let title = args.record.display().to_string();
        super::print(&report(title, &check, &blocks).to_text())?;
    }
    Ok(())
}

fn report(title: String, check: &Check, blocks: &[Subsystem]) -> Report {
    let sampling = &check.sampling;
    let mut verdict = vec![format!(
        "{} {} in {:.2} s, one each {:.4} ms (jitter {:.1} %), gaps: {}.",
        sampling.rows,
        if sampling.rows == 1 { "row" } else { "rows" },
        sampling.length_s,
        1e3 * sampling.period_s,
        100.0 * sampling.jitter,
        sampling.gaps
    )];
    verdict.extend(check.errors.iter().map(|error| format!("Error: {error}.")));
    verdict.extend(
        check
            .warnings
            .iter()
            .map(|warning| format!("Warning: {warning}.")),
    );
    let table = |caption: &str, columns: &[&str], rows| Table {
        caption: caption.into(),
        columns: columns.iter().map(|column| (*column).into()).collect(),
        rows,
    };
    let signals = table(
        "Measured signals, in the columns' units; the rate is the 95th percentile",
        &[
            "signal",
            "minimum",
            "maximum",
            "noise",
            "step",
            "rate /s",
            "steps",
            "reversals",
            "longest hold",
        ],
        check.signals.iter().map(row).collect(),
    );
    let blocks = table(
        "Subsystems that can be diagnosed",
        &[
            "subsystem",
            "sufficient",
            "missing columns, or effects hardly shown",
        ],
        blocks.iter().map(block_row).collect(),
    );
    Report {
        title,
        verdict,
        sections: vec![Section {
            heading: "Record".into(),
            text: Vec::new(),
            tables: vec![signals, blocks],
            plots: Vec::new(),
            ..Section::default()
        }],
        repeat: Vec::new(),
    }
}

fn row(signal: &Signal) -> Vec<String> {
    vec![
        signal.name.into(),
        super::short(signal.min),
        super::short(signal.max),
        super::short(signal.noise),
        signal.quantum.map_or_else(String::new, super::short),
        super::short(signal.rate_per_s),
        signal.steps.to_string(),
        signal.reversals.to_string(),
        format!("{:.1} s", signal.longest_hold_s),
    ]
}

fn block_row(block: &Subsystem) -> Vec<String> {
    let remarks = if block.missing.is_empty() {
        block.blind_to.join("; ")
    } else {
        block.missing.join("; ")
    };
    let enough = if block.enough { "yes" } else { "no" };
    vec![block.name.into(), enough.into(), remarks]
}
