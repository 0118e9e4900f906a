//! `hil-sim simulate`.

use super::Failure;
use super::{Progress, between};
use hil_sim::error::BadInput;
use hil_sim::identify::gap;
use hil_sim::identify::simulate::{self, simulate_with};
use hil_sim::output::{same_file, write_atomically};
use hil_sim::record::{CONTRACTION, FORCE_N, PRESSURE_PA, Record};
use hil_sim::report::{Axis, Plot, Report, Role, Section, Series, Table};
use muscle_plant::simulation::TOLERANCE;
use std::path::{Path, PathBuf};

/// Simulate the plant with the inputs of a record
///
/// With a column `pressure_ref_pa` valve and gas are simulated, without it the measured pressure is
/// the input. With `load.kind = "prescribed"` the measured contraction is an input too. The initial
/// state is estimated from the record's first second. The other measured
/// signals are compared with the simulated ones.
#[derive(clap::Args)]
#[command(after_help = "\
Example:
  hil-sim simulate --rig rig.toml --drive measured.csv --out sim.csv --report gap.html")]
pub struct Args {
    /// The rig
    #[arg(long, value_name = "RIG")]
    rig: PathBuf,
    /// The record whose inputs are used
    #[arg(long, value_name = "REC.csv")]
    drive: PathBuf,
    /// The record to write, with the same columns at the same times
    #[arg(long, value_name = "SIM.csv")]
    out: PathBuf,
    /// A report to write, with the measured signals beside the simulated ones
    #[arg(long, value_name = "REPORT.html")]
    report: Option<PathBuf>,
    /// Print the gaps as JSON instead of text
    #[arg(long)]
    json: bool,
    /// Permitted local error per step, relative to the range of each quantity
    #[arg(long, default_value_t = TOLERANCE, value_parser = between(1e-12, 1e-2))]
    tolerance: f64,
}

/// Refuses outputs that would overwrite an input or each other, or have no folder.
fn check_outputs(args: &Args) -> Result<(), BadInput> {
    let bad = |path: &Path, expected: &str| {
        let file = path.display().to_string();
        Err(BadInput::file(file, expected))
    };
    for output in [Some(&args.out), args.report.as_ref()]
        .into_iter()
        .flatten()
    {
        if same_file(output, &args.drive) || same_file(output, &args.rig) {
            return bad(output, "an output that is not an input too");
        }
        let folder = output.parent().unwrap_or(output);
        if output.is_dir() {
            return bad(output, "a file, found a folder");
        }
        if !(folder.as_os_str().is_empty() || folder.is_dir()) {
            return bad(output, "a file in a folder that is there");
        }
    }
    match &args.report {
        Some(report) if same_file(report, &args.out) => {
            bad(report, "a report beside --out, not in its place")
        }
        _ => Ok(()),
    }
}

/// The signals that are simulated: column, name, unit, factor from the SI value to it.
const SIGNALS: [(&str, &str, &str, f64); 3] = [
    (PRESSURE_PA, "gauge pressure", "kPa", 1e-3),
    (CONTRACTION, "contraction", "%", 100.0),
    (FORCE_N, "force", "N", 1.0),
];

/// The report on a simulation of inputs alone, as of a test signal.
fn without_measurement(simulated: &Record) -> Report {
    let (mut rows, mut plots) = (Vec::new(), Vec::new());
    for (column, name, unit, factor) in SIGNALS {
        let Some(values) = simulated.column(column) else {
            continue;
        };
        let low = values.iter().copied().fold(f64::INFINITY, f64::min);
        let high = values.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        let [low, high] =
            [low, high].map(|value| format!("{} {unit}", super::short(factor * value)));
        rows.push(vec![name.into(), low, high]);
        plots.push(Plot {
            title: format!("Simulated {name}"),
            caption: String::new(),
            x: Axis::new("time", "s", 1.0),
            y: Axis::new(name, unit, factor),
            series: vec![
                Series::thinned("simulated", simulated.time_s(), values).role(Role::Nominal),
            ],
            markers: Vec::new(),
            sync: Some("simulated".into()),
        });
    }
    Report {
        title: "Simulation".into(),
        verdict: vec!["The record measured nothing that is simulated: nothing is compared.".into()],
        sections: vec![Section {
            heading: "Signals".into(),
            tables: vec![Table {
                caption: "Range of each simulated signal".into(),
                columns: ["signal", "minimum", "maximum"].map(String::from).to_vec(),
                rows,
            }],
            plots,
            ..Section::default()
        }],
        repeat: Vec::new(),
    }
}

/// Runs the command.
pub fn run(args: &Args) -> Result<(), Failure> {
    let rig = super::read_rig(&args.rig)?;
    let record = super::read_record(&args.drive, Some(&rig))?;
    check_outputs(args)?;
    let simulated = {
        let progress = Progress::new("simulating", record.time_s().len() as u64);
        simulate_with(&rig, &record, args.tolerance, || progress.step())?
    };
    let gaps = gap::gaps(&record, &simulated, simulate::simulated(&rig, &record));
    let mut report = match gaps.is_empty() {
        true => without_measurement(&simulated),
        false => gap::report(&record, &simulated, &gaps),
    };
    report.repeat = vec![super::this_command()];
    simulated.write(&args.out)?;
    if let Some(path) = &args.report {
        write_atomically(path, report.to_html().as_bytes())?;
    }
    if args.json {
        super::print_json(&gaps)?;
    } else {
        super::print(&report.to_text())?;
    }
    super::note_left_out([&record]);
    Ok(())
}
