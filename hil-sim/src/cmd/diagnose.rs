//! `hil-sim diagnose`.

use crate::Failure;
use hil_sim::diagnose;
use hil_sim::record::Record;
use hil_sim::rig::Rig;
use std::path::PathBuf;

/// Find where simulation and measurement disagree, and name the missing effect
#[derive(clap::Args)]
pub struct Args {
    /// The nominal rig
    #[arg(long, value_name = "RIG")]
    rig: PathBuf,
    /// A record to fit to
    #[arg(long, value_name = "REC.csv", required = true)]
    fit: Vec<PathBuf>,
    /// A record to judge by
    #[arg(long, value_name = "REC.csv")]
    validate: Vec<PathBuf>,
    /// Leave an effect out of the catalogue
    #[arg(long, value_name = "NAME")]
    without: Vec<String>,
}

/// Runs the command.
pub fn run(args: &Args) -> Result<(), Failure> {
    let rig = Rig::read(&args.rig)?;
    let read = |paths: &[PathBuf]| {
        let records = paths.iter().map(|path| Record::read(path));
        records.collect::<Result<Vec<_>, _>>()
    };
    diagnose::explore(&rig, &read(&args.fit)?, &read(&args.validate)?, &args.without)?;
    Ok(())
}
