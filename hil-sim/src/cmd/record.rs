//! `hil-sim record`.

use super::Failure;
use super::board::{Connected, connect, describe, origin};
use super::hil::{no_progress, print_tenths};
use hil_sim::bench::board_settings::from_rig_and_board;
use hil_sim::bench::closed_loop::Run;
use hil_sim::bench::hil::{self, Job};
use hil_sim::bench::person::CHECKED_S;
use hil_sim::bench::player::{End, Player};
use hil_sim::bench::port::client::{LinkCounts, LinkError};
use hil_sim::bench::recorder::{Recorder, Timeline};
use hil_sim::bench::view::View;
use hil_sim::error::BadInput;
use hil_sim::output::same_file;
use hil_sim::record::columns::Row;
use hil_sim::record::mcap::Origin;
use model_core::device::Command;
use model_core::error::SettingsError;
use model_core::io::Request;
use model_core::link::{FromDevice, Source, Telemetry, ToDevice, Written};
use model_core::settings::{Settings, SettingsValues};
use model_core::supervisor::Mode;
use model_core::timing::Timing;
use serde::Serialize;
use std::io::IsTerminal;
use std::path::{Path, PathBuf};
use std::sync::Mutex;
use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};

/// After this time without a message, the rows received so far are written.
const TICK: Duration = Duration::from_millis(50);
/// For this time a board may let the pressure out, before it takes its old settings back.
const VENTING: Duration = Duration::from_secs(60);
/// Said if an interrupt ends the program while a board plays a test signal.
#[cfg(feature = "terminal")]
const LAST_WORDS: &str = "ended out of order: the board may still allow test signals (`hil-sim \
                          settings` shows play_pressure_pa_max), and the muscle may hold pressure \
                          behind a shut-off valve";

/// Record the telemetry of a board until interrupted
///
/// Writes REC.csv, and the same as .mcap for Foxglove and PlotJuggler, every half second, so that
/// at most this is lost if the program is killed. If the port is unplugged, waits for it to return.
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  hil-sim record --port /dev/ttyACM0 --out bench.csv
  hil-sim record --port COM3 --out bench.csv --from-start --duration 60
  hil-sim record --port COM3 --out bench.csv --play experiment.csv --write-settings
  hil-sim record --emulated rig.toml --out bench.csv --play experiment.csv")]
pub struct Args {
    /// The board's serial port
    #[arg(long, value_name = "PORT", required_unless_present = "emulated")]
    port: Option<String>,
    /// Play on an emulated board with this rig's plant in the loop, in place of a port
    #[arg(long, value_name = "RIG", conflicts_with = "port", requires = "play")]
    emulated: Option<PathBuf>,
    /// The record to write
    #[arg(long, value_name = "REC.csv")]
    out: PathBuf,
    /// Restart the controller first, so that the record can be replayed; refused while the
    /// board is armed
    #[arg(long)]
    from_start: bool,
    /// Overwrite existing files
    #[arg(long)]
    force: bool,
    /// Play this test signal on the board's muscle (see `hil-sim experiment`) and stop at its end;
    /// keep people away from the weight. The board's setting `play_pressure_pa_max` must permit it.
    /// Announces when to shut (`valve_open` 0) and open the shut-off valve
    #[arg(long, value_name = "EXP.csv", conflicts_with = "duration")]
    play: Option<PathBuf>,
    /// Raise `play_pressure_pa_max` on the board for --play, and restore it at the end
    #[arg(long, requires = "play")]
    write_settings: bool,
    /// Stop after this time [s]
    #[arg(long, value_name = "S", value_parser = super::between(0.0, 1e9))]
    duration: Option<f64>,
    /// Print a machine-readable summary instead of text
    #[arg(long)]
    json: bool,
}

#[derive(Serialize)]
struct Summary {
    board: String,
    record: String,
    ticks: usize,
    replayable: bool,
    /// How the test signal ended, if one was played.
    #[serde(skip_serializing_if = "Option::is_none")]
    played: Option<String>,
    /// Not with an emulated board in lockstep, whose report has it, and not without telemetry.
    #[serde(skip_serializing_if = "Option::is_none")]
    timing: Option<TimingSummary>,
    link: LinkCounts,
}

/// The board's own measurement of its ticks and its link, since its reset.
#[derive(Serialize)]
struct TimingSummary {
    tick_us_last: f64,
    tick_us_max: f64,
    late_us_max: f64,
    missed_ticks: u32,
    link_load: f64,
}

impl TimingSummary {
    fn new(cpu_hz: u32, timing: &Timing) -> TimingSummary {
        let microseconds = |cycles: u32| 1e6 * f64::from(cycles) / f64::from(cpu_hz.max(1));
        TimingSummary {
            tick_us_last: microseconds(timing.busy_cycles),
            tick_us_max: microseconds(timing.busy_cycles_max),
            late_us_max: microseconds(timing.late_cycles_max),
            missed_ticks: timing.missed_ticks_total,
            link_load: 1e-3 * f64::from(timing.link_per_mille),
        }
    }
}

impl std::fmt::Display for TimingSummary {
    fn fmt(&self, f: &mut std::fmt::Formatter) -> std::fmt::Result {
        write!(
            f,
            "The board's ticks since its reset: {:.1} µs the last one, {:.1} µs the longest, at \
             most {:.1} µs late, {} missed. Its link is {:.0} % busy.",
            self.tick_us_last,
            self.tick_us_max,
            self.late_us_max,
            self.missed_ticks,
            100.0 * self.link_load
        )
    }
}

/// Runs the command.
pub fn run(args: &Args) -> Result<(), Failure> {
    check_name(args)?;
    let play = args.play.as_deref();
    let drive = play
        .map(|path| super::read_record(path, None))
        .transpose()?;
    let mut player = drive.as_ref().map(Player::new).transpose()?;
    if let (Some(rig), Some(player)) = (&args.emulated, &player) {
        return in_the_loop(args, rig, player);
    }
    let mut board = connect(args.port.as_deref())?;
    let words = describe(&board.identity);
    super::note(format_args!("board: {words}"));
    let values = board.line.settings()?;
    let settings = match &player {
        None => valid(&board.port, Settings::new(values))?,
        Some(player) => allowed(args, &board.port, player, values)?,
    };
    if *settings.values() != values {
        board.line.write_settings(settings.values())?;
    }
    let origin = origin(&mut board, settings.values())?;
    let mut recorder = Recorder::create(&args.out, &origin)?;
    #[cfg(feature = "terminal")]
    super::interrupt::last_words(player.as_ref().map(|_| LAST_WORDS));
    let from = match args.from_start {
        true => Some(board.line.restart_in_loop()?),
        false => None,
    };
    let mut timeline = Timeline::new(settings, from);
    let mut shutoff_valve = ShutoffValve::default();
    if player.as_ref().is_some_and(Player::has_shutoff) {
        eprintln!(
            "the muscle cannot vent behind the shut-off valve: secure the weight before you shut it"
        );
    }
    let playing = (&mut player, &mut shutoff_valve);
    let listened = listen(args, &mut board, &mut timeline, &mut recorder, playing);
    shutoff_valve.warn();
    if *settings.values() != values && restore(&mut board, &values).is_err() {
        eprintln!("the board still allows test signals: its old settings could not be restored");
    }
    #[cfg(feature = "terminal")]
    super::interrupt::last_words(None);
    let heard = listened?;
    let played = player.map(|player| ended(&player));
    print_summary(
        args,
        &Summary {
            board: words,
            record: args.out.display().to_string(),
            ticks: recorder.finish()?,
            replayable: heard.replayable,
            played,
            timing: heard
                .timing
                .map(|timing| TimingSummary::new(board.identity.cpu_hz, &timing)),
            link: board.line.counts(),
        },
    )
}

/// Stores the old settings on the board again. An interrupt has ended the test signal, and must not
/// end this too; the next one does.
fn restore(board: &mut Connected, values: &SettingsValues) -> Result<(), LinkError> {
    board.stop.store(false, Ordering::Relaxed);
    let begin = Instant::now();
    loop {
        match board.line.write_settings(values) {
            // It still plays, or lets the pressure out.
            Err(LinkError::NotStored(Written::Armed)) if begin.elapsed() < VENTING => {
                let vent = Command::Request(Request::Vent);
                board.line.send(&ToDevice::Command(vent))?;
            }
            done => return done,
        }
    }
}

fn print_summary(args: &Args, summary: &Summary) -> Result<(), Failure> {
    if args.json {
        super::print_json(summary)?;
    } else {
        let (ticks, record) = (summary.ticks, &summary.record);
        let lost = summary.link.telemetry_lost;
        super::print(&format!(
            "{ticks} ticks in {record}, {lost} lost in transmission.\n"
        ))?;
        if let Some(timing) = &summary.timing {
            super::print(&format!("{timing}\n"))?;
        }
        if let Some(played) = &summary.played {
            super::print(&format!("The test signal: {played}.\n"))?;
        }
        if !summary.replayable {
            super::print("It cannot be replayed: see --from-start.\n")?;
        }
    }
    Ok(())
}

/// Refuses to overwrite a record without --force, as a measurement cannot be repeated.
fn check_name(args: &Args) -> Result<(), BadInput> {
    let bad = |expected: &str| Err(BadInput::file(args.out.display().to_string(), expected));
    if args.out.extension().is_some_and(|ending| ending == "mcap") {
        return bad("a name for the CSV file: the MCAP file is written beside it");
    }
    let inputs = [&args.play, &args.emulated];
    if inputs
        .into_iter()
        .flatten()
        .any(|input| same_file(input, &args.out))
    {
        return bad("an output that is not an input too");
    }
    let is_there = args.out.exists() || args.out.with_extension("mcap").exists();
    if is_there && !args.force {
        return bad("a new file, found one that --force overwrites");
    }
    Ok(())
}

/// The board checks its settings too: an error means that its firmware has other limits.
fn valid(port: &str, settings: Result<Settings, SettingsError>) -> Result<Settings, BadInput> {
    settings.map_err(|error| BadInput::file(port, format!("a board whose settings pass, {error}")))
}

/// Settings with which the board may play the test signal: its own, or new ones if these may be
/// written.
fn allowed(
    args: &Args,
    port: &str,
    player: &Player,
    values: SettingsValues,
) -> Result<Settings, BadInput> {
    let asked_pa = player.pressure_pa_max();
    if asked_pa <= values.play_pressure_pa_max {
        return valid(port, Settings::new(values));
    }
    let found_pa = values.play_pressure_pa_max;
    if !args.write_settings {
        let expected = format!(
            "a board whose play_pressure_pa_max is at least {asked_pa}, found {found_pa}: \
             --write-settings stores it on the board"
        );
        return Err(BadInput::file(port, expected));
    }
    let values = SettingsValues {
        play_pressure_pa_max: asked_pa,
        ..values
    };
    playing(port, values)
}

/// `values` with the highest pressure of the test signal permitted.
fn playing(port: &str, values: SettingsValues) -> Result<Settings, BadInput> {
    Settings::new(values).map_err(|error| {
        let asked_pa = values.play_pressure_pa_max;
        let expected = format!("a board that may play up to {asked_pa} Pa, {error}");
        BadInput::file(port, expected)
    })
}

/// Plays on the emulated board in closed loop with the plant of the rig at `path`.
fn in_the_loop(args: &Args, path: &Path, player: &Player) -> Result<(), Failure> {
    let rig = super::read_rig(path)?;
    let mut board = connect(None)?;
    let words = describe(&board.identity);
    super::note(format_args!("board: {words}"));
    let own = board.line.settings()?;
    let values = SettingsValues {
        play_pressure_pa_max: player.pressure_pa_max(),
        ..*from_rig_and_board(&rig, &own)?.values()
    };
    let settings = playing(&board.port, values)?;
    board.line.write_settings(settings.values())?;
    let experiment = Run {
        play: Some(player.clone()),
        // No hand acts on the lever.
        arm_stiffness_n_per_m: 0.0,
        duration_s: CHECKED_S + player.length_s() + 1.0,
        ..Run::PAPER
    };
    let is_terminal = std::io::stderr().is_terminal();
    let job = Job {
        rig: &rig,
        settings,
        run: &experiment,
        progress: if is_terminal {
            print_tenths
        } else {
            no_progress
        },
        real_time: false,
    };
    let view = Mutex::new(View::new(&words, board.identity.cpu_hz));
    let origin = Origin {
        rig: Some(path.display().to_string()),
        seed: Some(experiment.seed),
        ..origin(&mut board, settings.values())?
    };
    let recorder = Recorder::create(&args.out, &origin)?;
    let (ticks, report) = hil::run(&mut board.line, "experiment", &job, recorder, &view)?;
    let _ = board.line.leave();
    let last = ticks.last().map(|tick| tick.output);
    let played = match last.map(|output| (output.mode, output.fault)) {
        Some((Mode::Venting, None)) => "played to its end".into(),
        Some((_, Some(fault))) => format!("ended by a fault, {fault}"),
        _ => "interrupted".into(),
    };
    print_summary(
        args,
        &Summary {
            board: words,
            record: args.out.display().to_string(),
            ticks: ticks.len(),
            replayable: true,
            played: Some(played),
            timing: None,
            link: report.link,
        },
    )
}

/// How the test signal ended, as text.
fn ended(player: &Player) -> String {
    match player.end() {
        Some(End::Played) => "played to its end".into(),
        Some(End::Failed(fault)) => format!("ended by a fault, {fault}"),
        Some(End::Vented) => "vented before its end".into(),
        Some(End::Refused(mode)) => format!("not played, the board was in {mode}"),
        None => "interrupted".into(),
    }
}

/// Ticks between the announcement of an action at the shut-off valve and the action.
const AHEAD_TICKS: u32 = 300;

/// Instructions to the person at the shut-off valve between valve and pressure sensor: whether it
/// is shut in 3 s, and whether it is shut now.
#[derive(Default)]
struct ShutoffValve {
    soon: bool,
    now: bool,
}

impl ShutoffValve {
    /// Prints the instructions that are new at `tick`, also if ticks were lost.
    fn instruct(&mut self, player: &Player, tick: u32) {
        let verb = |shut: bool| if shut { "shut" } else { "open" };
        let soon = player.is_shut(tick.wrapping_add(AHEAD_TICKS));
        if soon != self.soon {
            eprintln!("in 3 s: {} the shut-off valve", verb(soon));
        }
        let now = player.is_shut(tick);
        if now != self.now {
            eprintln!("{} the shut-off valve NOW", verb(now));
        }
        *self = ShutoffValve { soon, now };
    }

    /// Warns that the muscle may hold pressure behind the shut valve.
    fn warn(&self) {
        if self.now {
            eprintln!(
                "the shut-off valve was to be shut: the muscle may hold pressure. Secure the \
                 weight before you open it"
            );
        }
    }
}

/// Sends the board the request that is due.
fn play(
    player: &mut Player,
    shutoff_valve: &mut ShutoffValve,
    board: &mut Connected,
    telemetry: &Telemetry,
) -> Result<(), LinkError> {
    let request = player.request(telemetry.tick, &telemetry.output);
    // While it vents no action is required.
    if telemetry.output.mode == Mode::Playing {
        shutoff_valve.instruct(player, telemetry.tick);
    }
    match request {
        Request::None => Ok(()),
        request => board
            .line
            .send(&ToDevice::Command(Command::Request(request))),
    }
}

/// What was heard from a board.
#[derive(Default)]
struct Heard {
    /// The record can be replayed.
    replayable: bool,
    /// Of the last tick; `None` if no telemetry came.
    timing: Option<Timing>,
}

/// Records until an interrupt or the end of the duration.
fn listen(
    args: &Args,
    board: &mut Connected,
    timeline: &mut Timeline,
    recorder: &mut Recorder,
    (player, shutoff_valve): (&mut Option<Player>, &mut ShutoffValve),
) -> Result<Heard, Failure> {
    let begin = Instant::now();
    let mut outcome = Heard::default();
    let mut progress = Progress::default();
    let mut heard = false;
    loop {
        let elapsed_s = begin.elapsed().as_secs_f64();
        if args
            .duration
            .is_some_and(|duration_s| elapsed_s >= duration_s)
        {
            return Ok(outcome);
        }
        let message = match board.line.next(TICK) {
            Err(LinkError::Stopped) => return Ok(outcome),
            message => message?,
        };
        for line in board.line.take_log() {
            eprintln!("{line}");
        }
        match message {
            Some(FromDevice::Telemetry(telemetry)) => {
                if telemetry.source != Source::Pins {
                    // No other program can use the port, so --from-start has selected this source.
                    board.line.send(&ToDevice::Command(Command::LeaveHil))?;
                }
                if let (Some(player), Source::Pins) = (&mut *player, telemetry.source) {
                    play(player, shutoff_valve, board, &telemetry)?;
                }
                if let Some(mut row) = timeline.row(&telemetry, elapsed_s) {
                    row.shut = player.as_ref().map(|_| shutoff_valve.now);
                    outcome.replayable |= row.start_settings.is_some();
                    recorder.push(&row)?;
                    progress.show(&row);
                }
                outcome.timing = Some(telemetry.timing);
                heard = true;
                if player.as_ref().is_some_and(|player| player.end().is_some()) {
                    return Ok(outcome);
                }
            }
            // After a reset.
            Some(FromDevice::Identity(identity)) => {
                eprintln!("the board has been reset: {:?}", identity.reset);
                board.line.send(&ToDevice::ReadSettings)?;
            }
            Some(FromDevice::Settings(values)) => {
                timeline.set_settings(valid(&board.port, Settings::new(values))?);
            }
            Some(FromDevice::Written(_) | FromDevice::Change(_)) => {}
            None => {
                if std::mem::take(&mut heard) {
                    recorder.flush()?;
                }
            }
        }
    }
}

/// The status line on the terminal, updated each second.
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
            .map_or(String::new(), |fault| format!(", {fault}"));
        let mode = output.mode;
        eprint!(
            "\r{:.0} s: {mode}{fault}, {pressure_kpa:.0} kPa   ",
            row.time_s
        );
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn timing_is_told_in_microseconds_of_the_boards_clock() {
        let timing = Timing {
            busy_cycles: 7_200,
            busy_cycles_max: 14_400,
            late_cycles_max: 72,
            missed_ticks_total: 3,
            link_per_mille: 70,
            ..Timing::default()
        };
        let text = TimingSummary::new(144_000_000, &timing).to_string();
        let expected = "50.0 µs the last one, 100.0 µs the longest, at most 0.5 µs late, 3 missed. \
                        Its link is 7 % busy.";
        assert!(text.ends_with(expected), "{text}");
    }
}
