//! `hil-sim export`.

use super::Failure;
use hil_sim::error::BadInput;
use hil_sim::fmu::{Experiment, Model, library_name, package};
use hil_sim::output::{same_file, write_atomically};
use hil_sim::rig::Rig;
use std::path::{Path, PathBuf};

/// Write a rig as an FMU, for other simulators
///
/// The FMU (FMI 3.0, co-simulation) contains the rig and a shared library; who imports it needs
/// nothing else. Its parameters are the rig's numbers, and a switch and the values of each effect.
/// Without a section `valve` the pressure is an input; with `load.kind = "prescribed"` the
/// contraction is.
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  hil-sim export --fmu rig.fmu rig.fitted.toml
  hil-sim export --fmu rig.fmu rig.fitted.toml --drive measured.csv")]
pub struct Args {
    /// The FMU to write
    #[arg(long, value_name = "OUT.fmu")]
    fmu: PathBuf,
    /// The rig
    #[arg(value_name = "RIG")]
    rig: PathBuf,
    /// A record whose first second gives the initial state, as in `simulate`, and whose times the
    /// default experiment; at rest from 0 to 10 s if omitted
    #[arg(long, value_name = "REC.csv")]
    drive: Option<PathBuf>,
    /// The shared library of the crate `fmu`, once for each platform; the one beside this program
    /// if omitted
    #[arg(long, value_name = "LIB")]
    library: Vec<PathBuf>,
}

fn bad(path: &Path, expected: impl Into<String>) -> BadInput {
    BadInput::file(path.display().to_string(), expected)
}

/// The shared library beside this program.
fn beside_this_program() -> PathBuf {
    let program = std::env::current_exe().unwrap_or_default();
    program.with_file_name(library_name())
}

fn read_library(path: &Path) -> Result<Vec<u8>, BadInput> {
    std::fs::read(path).map_err(|error| {
        let build = "`cargo build --release -p fmu`, named with --library or beside hil-sim";
        bad(
            path,
            format!("the shared library that is built by {build}, {error}"),
        )
    })
}

/// Refuses an output in the place of an input.
fn check_output(args: &Args, libraries: &[PathBuf]) -> Result<(), BadInput> {
    let inputs = libraries.iter().chain([&args.rig]).chain(&args.drive);
    for input in inputs {
        if same_file(&args.fmu, input) {
            return Err(bad(&args.fmu, "an output that is not an input too"));
        }
    }
    Ok(())
}

/// Runs the command.
pub fn run(args: &Args) -> Result<(), Failure> {
    let rig = super::read_rig(&args.rig)?;
    // Without what is in other files.
    let text = rig.rewritten(&Rig::read_text(&args.rig)?);
    let text = text.map_err(|error| bad(&args.rig, format!("TOML, {error}")))?;
    let mut model = Model::new(&args.rig.display().to_string(), &text)?;
    let mut experiment = Experiment::default();
    if let Some(path) = &args.drive {
        let record = super::read_record(path, Some(&rig))?;
        model.start_from(&record)?;
        let time_s = record.time_s();
        let (start_s, stop_s) = (time_s[0], time_s[time_s.len() - 1]);
        experiment.start_s = start_s;
        experiment.stop_s = stop_s;
        if time_s.len() > 1 {
            experiment.step_s = (stop_s - start_s) / (time_s.len() - 1) as f64;
        }
    }
    let paths = match &args.library[..] {
        [] => vec![beside_this_program()],
        paths => paths.to_vec(),
    };
    check_output(args, &paths)?;
    let libraries = paths.iter().map(|path| read_library(path));
    let libraries = libraries.collect::<Result<Vec<_>, _>>()?;
    let name = args.rig.file_stem().unwrap_or_default().to_string_lossy();
    let fmu = package(&model, &name, experiment, &libraries)
        .map_err(|(number, expected)| bad(&paths[number], expected))?;
    write_atomically(&args.fmu, &fmu)?;
    super::note(format_args!(
        "{}: {} kB",
        args.fmu.display(),
        fmu.len() / 1000
    ));
    Ok(())
}
