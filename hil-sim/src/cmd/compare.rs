//! `hil-sim compare`.

use super::Failure;
use hil_sim::error::BadInput;
use hil_sim::identify::compare::{Diagnosed, compare};
use hil_sim::output::{same_file, write_atomically};
use std::path::PathBuf;

/// Compare two diagnoses: verdicts, effects with their intervals, and gaps by signal
#[derive(clap::Args)]
#[command(after_help = "\
Example:
  hil-sim compare before/ after/ --report comparison.html")]
pub struct Args {
    /// A diagnosis: the folder that `diagnose --out` wrote, or its diagnosis.json
    #[arg(value_name = "A")]
    a: PathBuf,
    /// Another one
    #[arg(value_name = "B")]
    b: PathBuf,
    /// A report to write
    #[arg(long, value_name = "REPORT.html")]
    report: Option<PathBuf>,
    /// Print the comparison as JSON instead of text
    #[arg(long)]
    json: bool,
}

/// Runs the command.
pub fn run(args: &Args) -> Result<(), Failure> {
    let both = [Diagnosed::read(&args.a)?, Diagnosed::read(&args.b)?];
    let comparison = compare(&both);
    let mut report = comparison.report();
    report.repeat = vec![super::this_command()];
    if let Some(path) = &args.report {
        if both.iter().any(|input| same_file(path, input.file())) {
            let file = path.display().to_string();
            return Err(BadInput::file(file, "an output that is not an input too").into());
        }
        write_atomically(path, report.to_html().as_bytes())?;
    }
    if args.json {
        super::print_json(&comparison)?;
    } else {
        super::print(&report.to_text())?;
    }
    Ok(())
}
