//! `hil-sim settings`.

use super::Failure;
use super::board::{Connected, connect};
use hil_sim::bench::settings_file::{self, changed};
use hil_sim::output::write_atomically;
use model_core::link::Change;
use std::path::PathBuf;

/// Read the settings of a board, or store new ones on it
///
/// The format is TOML. Without --out the settings are printed. Settings of the safety block are
/// stored when the board's button is held for 2 s while its lamp flickers.
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  hil-sim settings --port /dev/ttyACM0 --out board.toml
  hil-sim settings --port /dev/ttyACM0 --write compensation/settings.toml
  hil-sim settings --port /dev/ttyACM0 --history")]
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
    /// Print what was changed on the board, by whom and when, instead of the settings
    #[arg(long, conflicts_with_all = ["write", "out", "json"])]
    history: bool,
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
    if args.history {
        return print_history(&mut board);
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

/// The newest first, as far back as the board has them.
fn print_history(board: &mut Connected) -> Result<(), Failure> {
    let mut newer: Option<Change> = None;
    let mut text = String::new();
    for back in 0..=u16::MAX {
        let change = board.line.change(back)?;
        if let Some(newer) = newer {
            text += &changed(&newer, change.as_ref().map(|change| &change.values));
        }
        newer = change;
        if newer.is_none() {
            break;
        }
    }
    if text.is_empty() {
        text = "no settings were ever stored\n".into();
    }
    Ok(super::print(&text)?)
}
