//! `hil-sim paper`.

use super::Common;
use super::Failure;
use hil_sim::bench::closed_loop::Run;
use hil_sim::bench::tick::record;
use hil_sim::paper::paper;

/// Compare the simulation with the paper's figures and numbers
#[derive(clap::Args)]
#[command(after_help = "\
The controller is the board's without its limit of the energy that a limb may receive, which the
paper's does not have: `replay` finds that difference in the run of valve A.

Examples:
  hil-sim paper
  hil-sim paper --rig rig.toml --out my-rig --json")]
pub struct Args {
    #[command(flatten)]
    common: Common,
}

/// Runs the command.
pub fn run(args: &Args) -> Result<(), Failure> {
    let rig = args.common.rig()?;
    let (report, summary, runs) = paper(&rig, &Run::PAPER)?;
    for run in &runs {
        let path = args.common.results.record_path(&run.name)?;
        record(&run.settings, &run.ticks).write(&path)?;
    }
    args.common.results.finish(report, &summary)
}
