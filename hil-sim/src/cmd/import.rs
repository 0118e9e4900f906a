//! `hil-sim import`.

use super::Failure;
use hil_sim::error::BadInput;
use hil_sim::output::same_file;
use hil_sim::record::import::{ColumnSummary, Map, Mended, Summary};
use hil_sim::report::{Report, Section, Table};
use std::path::PathBuf;

/// Convert a CSV or MATLAB file with other names and units into a record
///
/// The mapping file assigns the columns and their units. Prints the number of rows, the
/// conversions, the ranges, and times that do not increase.
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  hil-sim import --example > map.toml
  hil-sim import bench.txt --map map.toml --out bench.csv
  hil-sim import bench.mat --map map.toml --out bench.csv --json
  hil-sim import bar.csv --unit pressure_pa=bar --unit contraction=1,scale=-1 --out si.csv")]
pub struct Args {
    /// The file to convert: CSV, or MATLAB's .mat
    #[arg(value_name = "FILE", required_unless_present = "example")]
    file: Option<PathBuf>,
    /// The mapping file
    #[arg(long, value_name = "MAP.toml", required_unless_present_any = ["example", "unit"])]
    map: Option<PathBuf>,
    /// Of a file whose columns already have a record's names: the unit of one of them, and what its
    /// cells are multiplied by and what is added; may be given more than once
    #[arg(
        long,
        value_name = "COLUMN=UNIT[,scale=S][,offset=O]",
        conflicts_with = "map"
    )]
    unit: Vec<String>,
    /// The record to write
    #[arg(long, value_name = "REC.csv", required_unless_present = "example")]
    out: Option<PathBuf>,
    /// Print the summary as JSON instead of text
    #[arg(long)]
    json: bool,
    /// Only print a commented mapping file
    #[arg(long, exclusive = true)]
    example: bool,
}

/// Runs the command.
pub fn run(args: &Args) -> Result<(), Failure> {
    // clap requires both without --example, and a mapping or units.
    let (Some(file), Some(out)) = (&args.file, &args.out) else {
        super::print(Map::EXAMPLE_TOML)?;
        return Ok(());
    };
    if same_file(out, file) || args.map.as_ref().is_some_and(|map| same_file(out, map)) {
        let expected = "an output that is not an input too";
        return Err(BadInput::file(out.display().to_string(), expected).into());
    }
    let map = args.map.as_deref().map(Map::read).transpose()?;
    let name = file.display().to_string();
    let bytes = std::fs::read(file)
        .map_err(|error| BadInput::file(&name, format!("a readable file, {error}")))?;
    let map = match map {
        Some(map) => map,
        None => Map::of_record(&name, &bytes, &args.unit)?,
    };
    let imported = map.import(&name, &bytes)?;
    imported.record.write(out)?;
    if args.json {
        super::print_json(&imported.summary)?;
    } else {
        super::print(&report(name, &imported.summary).to_text())?;
    }
    Ok(())
}

fn report(title: String, summary: &Summary) -> Report {
    let mut verdict = vec![
        format!(
            "{}: {} rows read, {} written.",
            summary.format, summary.rows_read, summary.rows_written
        ),
        format!("Time from {}.", summary.time),
    ];
    if let Some(encoding) = summary.encoding {
        verdict.push(format!("It is not UTF-8: read as {encoding}."));
    }
    let times = [
        ("the time of the row before", &summary.repeated_times),
        (
            "an earlier time than the row before",
            &summary.restarted_times,
        ),
    ];
    for (what, Mended { count, first, done }) in times {
        if let Some(first) = first {
            let place = if summary.format == "CSV" {
                "line"
            } else {
                "row"
            };
            verdict.push(format!(
                "{count} with {what} were {done}, the first in {place} {first}."
            ));
        }
    }
    if !summary.left_out.is_empty() {
        verdict.push(format!("Left out: {}.", summary.left_out.join(", ")));
    }
    let columns = [
        "column",
        "from",
        "converted",
        "missing",
        "minimum",
        "maximum",
    ];
    Report {
        title,
        verdict,
        sections: vec![Section {
            heading: "Columns".into(),
            tables: vec![Table {
                caption: "Written columns, in SI units".into(),
                columns: columns.map(String::from).to_vec(),
                rows: summary.columns.iter().map(row).collect(),
            }],
            ..Section::default()
        }],
        repeat: Vec::new(),
    }
}

fn row(column: &ColumnSummary) -> Vec<String> {
    vec![
        column.name.into(),
        column.source.clone(),
        column.conversion.clone(),
        column.missing.to_string(),
        super::short(column.min),
        super::short(column.max),
    ]
}
