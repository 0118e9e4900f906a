//! `hil-sim settings`.

use super::Failure;
use super::board::connect;
use hil_sim::bench::settings_file;
use hil_sim::output::write_atomically;
use std::path::PathBuf;

/// Read the settings of a board, or store new ones on it
///
/// The format is TOML. Without --out the settings are printed.
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  hil-sim settings --port /dev/ttyACM0 --out board.toml
  hil-sim settings --port /dev/ttyACM0 --write compensation/settings.toml")]
pub struct Args {
    /// The board's serial port; the emulated board if omitted
    #[arg(long, value_name = "PORT")]
    port: Option<String>,
    /// Store these settings on the board, which refuses while it assists
    #[arg(long, value_name = "FILE")]
    write: Option<PathBuf>,
    /// The file to write the settings to
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,
    /// Print the settings as JSON instead of TOML
    #[arg(long)]
    json: bool,
}

/// Runs the command.
pub fn run(args: &Args) -> Result<(), Failure> {
    let wanted = args.write.as_deref().map(settings_file::read).transpose()?;
    let mut board = connect(args.port.as_deref())?;
    if let Some(fault) = board.identity.start {
        eprintln!("start-up self-test: {fault}: {}", fault.help());
    }
    if let Some(wanted) = wanted {
        board.line.write_settings(wanted.values())?;
    }
    let settings = board.line.settings()?;
    let text = settings_file::to_toml(&settings);
    if let Some(path) = &args.out {
        write_atomically(path, text.as_bytes())?;
    }
    if args.json {
        super::print_json(&settings)?;
    } else if args.out.is_none() {
        super::print(&text)?;
    }
    Ok(())
}
