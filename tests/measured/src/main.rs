//! Diagnoses every measured set in a folder: report.html, measured.json and measured.md.

use clap::Parser;
use hil_sim::output::write_atomically;
use std::path::PathBuf;
use std::process::ExitCode;

/// Diagnoses every measured set in a folder
#[derive(Parser)]
#[command(version)]
struct Args {
    /// The folder with one folder a set; else MEASURED_DATA_DIR names it
    #[arg(long, value_name = "DIR")]
    data: Option<PathBuf>,
    /// Folder for the results, made if it is not there
    #[arg(long, value_name = "DIR", default_value = "out/measured")]
    out: PathBuf,
    /// Only the published benchmarks: tanks, EMPS, Bouc–Wen
    #[arg(long)]
    benchmarks: bool,
}

fn main() -> ExitCode {
    let args = Args::parse();
    let named = args
        .data
        .or_else(|| std::env::var_os("MEASURED_DATA_DIR").map(Into::into));
    let Some(folder) = named else {
        eprintln!(
            "measured: expected the folder of the measured sets in --data or MEASURED_DATA_DIR"
        );
        return ExitCode::from(2);
    };
    let (benchmarks, figures) = measured::benchmarks::all(&folder);
    let mut outcomes = if args.benchmarks {
        Vec::new()
    } else {
        measured::all(&folder)
    };
    outcomes.extend(benchmarks);
    let report = measured::report::report(&outcomes, &figures);
    let json = serde_json::to_string_pretty(&outcomes).unwrap_or_default() + "\n";
    let written = std::fs::create_dir_all(&args.out).map_err(|error| error.to_string());
    let written = written.and_then(|()| {
        let files = [
            ("report.html", report.to_html()),
            ("measured.json", json),
            (
                "measured.md",
                measured::report::markdown(&outcomes, &figures),
            ),
        ];
        files.iter().try_for_each(|(name, text)| {
            let path = args.out.join(name);
            write_atomically(&path, text.as_bytes()).map_err(|error| error.to_string())
        })
    });
    if let Err(error) = written {
        eprintln!("measured: {error}");
        return ExitCode::from(2);
    }
    println!("{}", report.to_text());
    ExitCode::SUCCESS
}
