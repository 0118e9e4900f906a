//! `hil-sim simulate`.

use crate::Failure;
use hil_sim::plant::simulation::TOLERANCE;
use hil_sim::record::Record;
use hil_sim::rig::Rig;
use hil_sim::simulate::simulate;
use std::path::PathBuf;

/// Run the plant from a record's inputs alone
///
/// With a column `pressure_ref_pa` valve and gas are simulated, without it the measured pressure is
/// the input. With `load.kind = "prescribed"` the measured contraction is an input too. The initial
/// state is estimated from the record's first second.
#[derive(clap::Args)]
#[command(after_help = "\
Example:
  hil-sim simulate --rig rig.toml --drive measured.csv --out sim.csv")]
pub struct Args {
    /// The rig
    #[arg(long, value_name = "RIG")]
    rig: PathBuf,
    /// The record whose inputs are used
    #[arg(long, value_name = "REC.csv")]
    drive: PathBuf,
    /// The record to write, with the same columns on the same times
    #[arg(long, value_name = "SIM.csv")]
    out: PathBuf,
    /// Local error allowed a step, relative to each quantity's range
    #[arg(long, default_value_t = TOLERANCE, value_parser = tolerance)]
    tolerance: f64,
}

fn tolerance(text: &str) -> Result<f64, String> {
    match text.parse() {
        Ok(value) if (1e-12..=1e-2).contains(&value) => Ok(value),
        _ => Err("expected a number from 1e-12 to 1e-2".into()),
    }
}

/// Runs the command.
pub fn run(args: &Args) -> Result<(), Failure> {
    let rig = Rig::read(&args.rig)?;
    let record = Record::read(&args.drive)?;
    simulate(&rig, &record, args.tolerance)?.write(&args.out)?;
    Ok(())
}
