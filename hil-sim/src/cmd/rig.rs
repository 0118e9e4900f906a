//! `hil-sim rig`.

use super::Failure;
use hil_sim::error::BadInput;
use hil_sim::output::write_atomically;
use hil_sim::rig::Rig;
use std::path::PathBuf;

/// Create and check rig files
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  hil-sim rig new my-rig.toml
  hil-sim rig check my-rig.toml")]
pub struct Args {
    #[command(subcommand)]
    command: Command,
}

#[derive(clap::Subcommand)]
enum Command {
    /// Write the paper's rig with comments, as a template
    #[command(after_help = "Example:\n  hil-sim rig new my-rig.toml")]
    New {
        /// The file to write
        #[arg(default_value = "rig.toml")]
        path: PathBuf,
        /// Overwrite an existing file
        #[arg(long)]
        force: bool,
    },
    /// Check a rig file and report its errors
    #[command(after_help = "Example:\n  hil-sim rig check my-rig.toml")]
    Check {
        /// The file to read
        path: PathBuf,
    },
}

/// Runs the command.
pub fn run(args: &Args) -> Result<(), Failure> {
    match &args.command {
        Command::New { path, force } => {
            if path.exists() && !force {
                let expected = "no file here, or --force to overwrite it";
                return Err(BadInput::file(path.display().to_string(), expected).into());
            }
            write_atomically(path, Rig::REFERENCE_TOML.as_bytes())?;
            eprintln!("written: {}", path.display());
        }
        Command::Check { path } => {
            let rig = Rig::read(path)?;
            let effects = rig.effects.len();
            super::print(&format!("{}: a rig, {effects} effects\n", path.display()))?;
        }
    }
    Ok(())
}
