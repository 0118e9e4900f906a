//! `hil-sim design`.

use super::Common;
use super::Failure;
use hil_sim::design::report::{Question, design_report};

/// Compute the required flow gain of the valve, and the permitted stiffness of the input
///
/// For selecting a valve: over a range of equilibrium pressures and loads, the flow gain at which
/// the pressure control is as fast as the weight on the muscle; whether the rig's valve has it; and
/// up to which K_s the sampled loop is stable.
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  hil-sim design
  hil-sim design --rig rig.toml --mass 8 --mass 12 --mass 16 --json")]
pub struct Args {
    #[command(flatten)]
    common: Common,
    /// Lowest equilibrium pressure [Pa]; a tenth of the supply if omitted
    #[arg(long)]
    pressure_min: Option<f64>,
    /// Highest equilibrium pressure [Pa]; the supply if omitted
    #[arg(long)]
    pressure_max: Option<f64>,
    /// A mass [kg], any number of times; the rig's if omitted
    #[arg(long)]
    mass: Vec<f64>,
}

/// Runs the command.
pub fn run(args: &Args) -> Result<(), Failure> {
    let rig = args.common.rig()?;
    let question = Question {
        pressure_pa_min: args.pressure_min,
        pressure_pa_max: args.pressure_max,
        masses_kg: args.mass.clone(),
    };
    let (report, summary) = design_report(&rig, &question)?;
    args.common.results.finish(report, &summary)
}
