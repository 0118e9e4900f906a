//! `hil-sim record`.

use super::board::{Connected, connect, in_words};
use crate::Failure;
use hil_sim::error::BadInput;
use hil_sim::link::{LinkCounts, LinkError};
use hil_sim::recorder::{Recorder, Row, Timeline};
use model_core::device::Command;
use model_core::error::SettingsError;
use model_core::link::{FromDevice, Source, ToDevice};
use model_core::settings::Settings;
use serde::Serialize;
use std::io::IsTerminal;
use std::path::PathBuf;
use std::time::{Duration, Instant};

/// Without a message for so long, what is there is written.
const TICK: Duration = Duration::from_millis(50);

/// Record what a board tells of each tick, until interrupted
///
/// Writes REC.csv and, with the ending .mcap, the same for Foxglove and PlotJuggler, half a second
/// at a time: a program that is killed loses no more. A port that is unplugged is waited for.
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  hil-sim record --port /dev/ttyACM0 --out bench.csv
  hil-sim record --port COM3 --out bench.csv --from-start --duration 60")]
pub struct Args {
    /// The board's serial port
    #[arg(long, value_name = "PORT")]
    port: String,
    /// The record to write
    #[arg(long, value_name = "REC.csv")]
    out: PathBuf,
    /// Have the controller begin anew first, so that the record can be replayed; refused while the
    /// board is armed
    #[arg(long)]
    from_start: bool,
    /// Overwrite files that are there
    #[arg(long)]
    force: bool,
    /// End after so long [s]
    #[arg(long, value_name = "S", value_parser = super::between(0.0, 1e9))]
    duration: Option<f64>,
    /// Print a machine-readable summary instead of words
    #[arg(long)]
    json: bool,
}

#[derive(Serialize)]
struct Summary {
    board: String,
    record: String,
    ticks: usize,
    replayable: bool,
    link: LinkCounts,
}

/// Runs the command.
pub fn run(args: &Args) -> Result<(), Failure> {
    check_name(args)?;
    let mut board = connect(Some(&args.port))?;
    let words = in_words(&board.identity);
    eprintln!("board: {words}");
    let mut recorder = Recorder::create(&args.out)?;
    let values = board.line.settings()?;
    let settings = valid(&args.port, Settings::new(values))?;
    let from = match args.from_start {
        true => Some(board.line.begin_anew()?),
        false => None,
    };
    let mut timeline = Timeline::new(settings, from);
    let replayable = listen(args, &mut board, &mut timeline, &mut recorder)?;
    let summary = Summary {
        board: words,
        record: args.out.display().to_string(),
        ticks: recorder.finish()?,
        replayable,
        link: board.line.counts(),
    };
    if args.json {
        super::print_json(&summary)?;
    } else {
        let (ticks, record) = (summary.ticks, &summary.record);
        let lost = summary.link.telemetry_lost;
        super::print(&format!(
            "{ticks} ticks in {record}, {lost} lost on the way.\n"
        ))?;
        if !replayable {
            super::print("It cannot be replayed: see --from-start.\n")?;
        }
    }
    Ok(())
}

/// Measurements cannot be had again: they are not overwritten by mistake.
fn check_name(args: &Args) -> Result<(), BadInput> {
    let bad = |expected: &str| Err(BadInput::file(args.out.display().to_string(), expected));
    if args.out.extension().is_some_and(|ending| ending == "mcap") {
        return bad("a name for the CSV file: the MCAP file will stand beside it");
    }
    let is_there = args.out.exists() || args.out.with_extension("mcap").exists();
    if is_there && !args.force {
        return bad("a new file, found one that --force overwrites");
    }
    Ok(())
}

/// The board checks them too: this is another firmware.
fn valid(port: &str, settings: Result<Settings, SettingsError>) -> Result<Settings, BadInput> {
    settings.map_err(|error| BadInput::file(port, format!("a board whose settings pass, {error}")))
}

/// Records until the user or the clock ends it; returns whether there is something to replay.
fn listen(
    args: &Args,
    board: &mut Connected,
    timeline: &mut Timeline,
    recorder: &mut Recorder,
) -> Result<bool, Failure> {
    let begin = Instant::now();
    let mut replayable = false;
    let mut progress = Progress::default();
    let mut heard = false;
    loop {
        let elapsed_s = begin.elapsed().as_secs_f64();
        if args
            .duration
            .is_some_and(|duration_s| elapsed_s >= duration_s)
        {
            return Ok(replayable);
        }
        let message = match board.line.next(TICK) {
            Err(LinkError::Stopped) => return Ok(replayable),
            message => message?,
        };
        for line in board.line.take_log() {
            eprintln!("{line}");
        }
        match message {
            Some(FromDevice::Telemetry(told)) => {
                if told.source != Source::Pins {
                    // Nobody else holds the port: it is our own start.
                    board.line.send(&ToDevice::Command(Command::LeaveHil))?;
                }
                if let Some(row) = timeline.row(&told, elapsed_s) {
                    replayable |= row.begins_with.is_some();
                    recorder.push(&row)?;
                    progress.show(&row);
                }
                heard = true;
            }
            // After a reset.
            Some(FromDevice::Identity(identity)) => {
                eprintln!("the board has been reset: {:?}", identity.reset);
                board.line.send(&ToDevice::ReadSettings)?;
            }
            Some(FromDevice::Settings(values)) => {
                timeline.set_settings(valid(&args.port, Settings::new(values))?);
            }
            Some(FromDevice::Written(_)) => {}
            None => {
                if std::mem::take(&mut heard) {
                    recorder.flush()?;
                }
            }
        }
    }
}

/// A line on the terminal, each second.
#[derive(Default)]
struct Progress {
    shown_s: f64,
}

impl Progress {
    fn show(&mut self, row: &Row) {
        if row.time_s < self.shown_s + 1.0 || !std::io::stderr().is_terminal() {
            return;
        }
        self.shown_s = row.time_s;
        let output = &row.output;
        let pressure_kpa = 1e-3 * output.pressure.0;
        let fault = output
            .fault
            .map_or(String::new(), |fault| format!(", {fault:?}"));
        let mode = output.mode;
        eprint!(
            "\r{:.0} s: {mode:?}{fault}, {pressure_kpa:.0} kPa   ",
            row.time_s
        );
    }
}
