//! `hil-sim check`.

use super::Failure;
use hil_sim::record::Record;
use hil_sim::record::check::{Signal, Subsystem, Summary, summary};
use hil_sim::report::{Report, Section, Table};
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

/// Runs the command.
pub fn run(args: &Args) -> Result<(), Failure> {
    let record = Record::read(&args.record)?;
    let rig = args.rig.as_deref().map(super::read_rig).transpose()?;
    let summary = summary(&record, rig.as_ref(), super::accepts())?;
    if args.json {
        super::print_json(&summary)?;
    } else {
        let title = args.record.display().to_string();
        super::print(&report(title, &summary).to_text())?;
    }
    Ok(())
}

fn report(title: String, check: &Summary) -> Report {
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
    if !check.left_out.is_empty() {
        verdict.push(format!("Left out: {}.", check.left_out.join(", ")));
    }
    let table = |caption: &str, columns: &[&str], rows| Table {
        caption: caption.into(),
        columns: columns.iter().map(|column| (*column).into()).collect(),
        rows,
    };
    let signals = table(
        "Measured signals; the rate is the 95th percentile",
        &[
            "signal",
            "unit",
            "minimum",
            "maximum",
            "noise",
            "step",
            "rate per s",
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
        check.blocks.iter().map(block_row).collect(),
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

/// The unit in which a person reads a column of SI units, and its size.
fn unit(column: &str) -> (&'static str, f64) {
    match column.rsplit_once('_') {
        Some((_, "pa")) => ("kPa", 1e-3),
        Some((_, "m")) => ("mm", 1e3),
        Some((_, "n")) => ("N", 1.0),
        Some((_, "k")) => ("K", 1.0),
        _ => ("-", 1.0),
    }
}

fn row(signal: &Signal) -> Vec<String> {
    let (unit, size) = unit(signal.name);
    let shown = |value: f64| super::short(size * value);
    vec![
        signal.name.into(),
        unit.into(),
        shown(signal.min),
        shown(signal.max),
        shown(signal.noise),
        signal.quantum.map_or_else(String::new, shown),
        shown(signal.rate_per_s),
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
