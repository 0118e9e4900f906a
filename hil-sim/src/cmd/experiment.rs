//! `hil-sim experiment`.

use super::Failure;
use super::between;
use hil_sim::bench::test_signal::{CONTRACTION_MAX, Limits, Part, PartSummary, test_signal};
use hil_sim::error::BadInput;
use hil_sim::output::same_file;
use std::path::PathBuf;

/// Write the test signal of the next experiment, within the rig's limits
///
/// Rest at zero pressure, triangles at three rates with minor loops, steps with holds of 60 s, a
/// multisine and growing steps: together they distinguish effects that a single signal cannot. The
/// muscle is vented at the beginning and at the end.
///
/// In shut-holds a person shuts a shut-off valve between valve and pressure sensor while
/// `valve_open` is 0. `hil-sim record --play` announces this and writes the column to the record,
/// which `simulate` and `diagnose` use. The muscle cannot be vented then: secure the weight.
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  hil-sim experiment --rig rig.toml --out experiment.csv
  hil-sim experiment --rig rig.toml --out leak.csv --part shut-holds")]
pub struct Args {
    /// The rig
    #[arg(long, value_name = "RIG")]
    rig: PathBuf,
    /// The test signal to write: time_s, pressure_ref_pa and, for shut-holds, valve_open
    #[arg(long, value_name = "EXP.csv")]
    out: PathBuf,
    /// A part of the signal; may be given more than once. All but shut-holds if omitted
    #[arg(long, value_enum)]
    part: Vec<Part>,
    /// Highest contraction at which a weight may be in equilibrium
    #[arg(long, default_value_t = CONTRACTION_MAX, value_parser = between(0.01, 0.9))]
    contraction_max: f64,
    /// Highest rate of the reference [Pa/s]; the limit of the board's reference settings if omitted
    #[arg(long, value_parser = between(100.0, 1e8))]
    rate_max: Option<f64>,
    /// Print a machine-readable summary instead of text
    #[arg(long)]
    json: bool,
}

/// Runs the command.
pub fn run(args: &Args) -> Result<(), Failure> {
    if same_file(&args.out, &args.rig) {
        let expected = "an output that is not an input too";
        return Err(BadInput::file(args.out.display().to_string(), expected).into());
    }
    let mut limits = Limits::of(&super::read_rig(&args.rig)?, args.contraction_max)?;
    limits.rate_pa_per_s_max = args.rate_max;
    let parts: &[Part] = match &args.part[..] {
        [] => &Part::DEFAULT,
        parts => parts,
    };
    let written = test_signal(&limits, parts);
    written.record.write(&args.out)?;
    let summary = written.summary(&limits, &args.out.display().to_string());
    if args.json {
        super::print_json(&summary)?;
    } else {
        let mut words = format!(
            "{}: {:.0} s, pressure from {:.0} to {:.0} kPa.\n",
            summary.experiment,
            summary.length_s,
            1e-3 * limits.low_pa,
            1e-3 * limits.high_pa
        );
        for PartSummary { part, begins_s } in &summary.parts {
            words += &format!("  {part} from {begins_s:.0} s\n");
        }
        super::print(&words)?;
    }
    Ok(())
}
