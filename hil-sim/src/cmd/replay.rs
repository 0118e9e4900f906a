//! `hil-sim replay`.

use super::Failure;
use super::board::{connect, describe};
use hil_sim::bench::replay::{Inputs, OnBoard, OnPc, Replay, replay};
use hil_sim::record::Record;
use hil_sim::record::mcap;
use serde::Serialize;
use std::io::IsTerminal;
use std::path::PathBuf;

/// Repeat a record's inputs with the controller, and compare its outputs tick by tick
///
/// The record contains the controller's settings, and its inputs as counts; every output must be
/// bit-identical. Without --emulated and --port the controller runs in this program.
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  hil-sim replay out/valve-B.csv
  hil-sim replay bench.mcap --emulated
  hil-sim replay bench.csv --port /dev/ttyACM0")]
pub struct Args {
    /// The record, as CSV or MCAP
    #[arg(value_name = "REC")]
    record: PathBuf,
    /// Run the firmware on the emulated board
    #[arg(long, conflicts_with = "port")]
    emulated: bool,
    /// Run the firmware on the board at this serial port
    #[arg(long, value_name = "PORT")]
    port: Option<String>,
    /// Store the record's settings on the board if its settings differ
    #[arg(long)]
    write_settings: bool,
    /// Print a machine-readable summary instead of text
    #[arg(long)]
    json: bool,
}

#[derive(Serialize)]
struct Summary {
    /// Where the controller ran.
    on: String,
    replay: Replay,
}

/// Runs the command.
pub fn run(args: &Args) -> Result<(), Failure> {
    let is_mcap = args
        .record
        .extension()
        .is_some_and(|ending| ending == "mcap");
    let record = match is_mcap {
        true => mcap::read(&args.record)?,
        false => Record::read(&args.record)?,
    };
    let inputs = Inputs::new(&record)?;
    let (on, replay) = if args.emulated || args.port.is_some() {
        on_board(args, &inputs)?
    } else {
        let replay = replay(&inputs, &mut OnPc::default(), |_| {})?;
        ("this PC".into(), replay)
    };
    if args.json {
        super::print_json(&Summary { on, replay })?;
    } else {
        super::print(&format!("On {on}: {}\n", replay.verdict()))?;
    }
    Ok(())
}

fn on_board(args: &Args, inputs: &Inputs) -> Result<(String, Replay), Failure> {
    let mut board = connect(args.port.as_deref())?;
    let words = describe(&board.identity);
    let mut on = OnBoard {
        client: &mut board.line,
        port: &board.port,
        may_write_settings: args.write_settings || args.port.is_none(),
    };
    let (all, shows) = (inputs.ticks(), std::io::stderr().is_terminal());
    let replay = replay(inputs, &mut on, |done| {
        if shows && done % 1000 == 0 {
            eprint!("\r{done} of {all} ticks ");
        }
    })?;
    if shows {
        eprintln!();
    }
    let _ = board.line.leave();
    Ok((words, replay))
}
