//! `hil-sim import`.

use super::Failure;
use hil_sim::error::BadInput;
use hil_sim::input;
use hil_sim::output::same_file;
use hil_sim::record::import::{ColumnSummary, Map, Mended, Summary};
use hil_sim::report::{Report, Section, Table};
use std::path::PathBuf;

/// Convert a CSV, xlsx, MATLAB, HDF5 or MCAP file with other names and units into a record
///
/// The mapping file assigns the columns and their units; a file with a record's names needs none.
/// Prints the number of rows, the conversions, the ranges, and times that do not increase.
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  hil-sim import --example > map.toml
  hil-sim import bench.txt --map map.toml --out bench.csv
  hil-sim import bench.mat --map map.toml --out bench.csv --json
  hil-sim import assist.mcap --out assist.csv
  hil-sim import bar.csv --unit pressure_pa=bar --unit contraction=1,scale=-1 --out si.csv")]
pub struct Args {
    /// The file to convert: CSV, xlsx, MATLAB's .mat, HDF5, or MCAP with JSON or ROS 2's messages
    #[arg(value_name = "FILE", required_unless_present = "example")]
    file: Option<PathBuf>,
    /// The mapping file
    #[arg(long, value_name = "MAP.toml")]
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
    // clap requires both without --example.
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
    let bytes = input::read(file, "a readable file")?;
    #[cfg(all(unix, feature = "formats"))]
    if hil_sim::record::import::is_read_by_crates(&bytes) {
        if bounded::is_parent() {
            return bounded::run(&name, bytes.len());
        }
        bounded::limit(bytes.len() as u64);
    }
    let map = match map {
        Some(map) => map,
        None => Map::of_record(&name, &bytes, &args.unit)?,
    };
    let imported = map.import(&name, bytes)?;
    imported.record.write(out)?;
    if args.json {
        super::print_json(&imported.summary)?;
    } else {
        super::print(&report(name, &imported.summary).to_text())?;
    }
    Ok(())
}

/// The import in a child process whose memory and time are limited.
///
/// Crates read HDF5, xlsx and MCAP. What they allocate for a damaged file is not in this program's
/// hands.
#[cfg(all(unix, feature = "formats"))]
mod bounded {
    use super::{BadInput, Failure};
    use rustix::process::{Resource, Rlimit, setrlimit};
    use std::process::{Command, Stdio};

    /// Set for the child.
    const CHILD: &str = "HIL_SIM_IMPORT_CHILD";
    /// What any import may take, and what it may take for each byte of the file: the numbers that
    /// [`hil_sim::record::import`] reads at most, their copies, and the program itself.
    const MEMORY_BYTES: u64 = 180_000_000;
    const MEMORY_PER_BYTE: u64 = 100;
    /// The same of processor time \[s\].
    const TIME_S: u64 = 2;
    const BYTES_PER_S: u64 = 2_000_000;

    /// The exit status after bad input.
    const BAD_INPUT: i32 = 2;

    pub fn is_parent() -> bool {
        std::env::var_os(CHILD).is_none()
    }

    /// Limits the memory and the time of this process, the child, for a file of that size.
    pub fn limit(file_bytes: u64) {
        let limit = |resource, most| {
            let most = Some(most);
            let limits = Rlimit {
                current: most,
                maximum: most,
            };
            // Without limits the file is read all the same.
            let _ = setrlimit(resource, limits);
        };
        let memory = MEMORY_BYTES.saturating_add(file_bytes.saturating_mul(MEMORY_PER_BYTE));
        limit(Resource::As, memory);
        limit(Resource::Cpu, TIME_S + file_bytes / BYTES_PER_S);
    }

    /// Runs this command again as a child, and passes on what it prints and returns.
    pub fn run(file: &str, file_bytes: usize) -> Result<(), Failure> {
        let program = std::env::current_exe();
        let child = program.and_then(|program| {
            Command::new(program)
                .args(std::env::args_os().skip(1))
                .env(CHILD, "")
                .stdin(Stdio::null())
                .stdout(Stdio::inherit())
                .stderr(Stdio::piped())
                .output()
        });
        let child = child
            .map_err(|error| BadInput::file(file, format!("a process to read it in, {error}")))?;
        match child.status.code() {
            // After bad input it has said why, in one line.
            Some(0 | BAD_INPUT) => {}
            // A signal, or a panic.
            _ => {
                let expected = format!(
                    "a file that can be read within {} MB, found none: it is damaged, or made to \
                     hurt",
                    (MEMORY_BYTES + file_bytes as u64 * MEMORY_PER_BYTE) / 1_000_000
                );
                return Err(BadInput::file(file, expected).into());
            }
        }
        eprint!("{}", String::from_utf8_lossy(&child.stderr));
        match child.status.code() {
            Some(0) => Ok(()),
            status => std::process::exit(status.unwrap_or(BAD_INPUT)),
        }
    }
}

fn report(title: String, summary: &Summary) -> Report {
    let mut verdict = vec![
        format!(
            "{}: {} rows read, {} written.",
            summary.format, summary.rows_read, summary.rows_written
        ),
        format!("Time from {}.", summary.time),
    ];
    verdict.extend(summary.notes.iter().cloned());
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
