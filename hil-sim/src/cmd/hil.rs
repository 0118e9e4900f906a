//! `hil-sim hil`.

use super::Common;
use super::Failure;
use super::board::{Connected, connect, describe, origin};
use super::run::Scenario;
#[cfg(feature = "terminal")]
use super::screen;
use hil_sim::bench::assist_run::{AssistRun, assist_plots, tracking_table};
use hil_sim::bench::board_report::BoardReport;
use hil_sim::bench::board_settings::{ensure, ensure_from_rig};
use hil_sim::bench::hil::{self, Job};
use hil_sim::bench::recorder::Recorder;
use hil_sim::bench::replay::{Inputs, OnPc, replay};
use hil_sim::bench::settings_file;
use hil_sim::bench::tick::{TICK_S, Tick};
use hil_sim::bench::tracking::Tracking;
use hil_sim::bench::view::View;
use hil_sim::paper::valves;
use hil_sim::record::Record;
use hil_sim::record::mcap::Origin;
use hil_sim::report::{Report, Section, Table};
use serde::Serialize;
use std::io::IsTerminal;
use std::path::PathBuf;
use std::sync::Mutex;
#[cfg(feature = "terminal")]
use std::sync::atomic::{AtomicBool, Ordering};

/// Run the assist experiment with the controller on a board and the plant on this PC
///
/// The sensor values are sent to the board over its serial link, and it returns the value of the
/// valve; its physical valve output stays at 0 V. Without --port the firmware runs on an emulated
/// board. Writes records as CSV and MCAP.
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  hil-sim hil                                   the firmware on an emulated board
  hil-sim hil --port /dev/ttyACM0               on a real one
  hil-sim hil --port COM3 --rig rig.toml --write-settings --travel 0.08

The emulated board runs the ELF that FIRMWARE names, or that `cargo firmware` has built.")]
pub struct Args {
    #[command(flatten)]
    common: Common,
    #[command(flatten)]
    scenario: Scenario,
    /// The board's serial port
    #[arg(long, value_name = "PORT", conflicts_with = "emulated")]
    port: Option<String>,
    /// Use the emulated board, as without --port
    #[arg(long)]
    emulated: bool,
    /// Store the rig's muscle, gain and supply on the board if its settings differ
    #[arg(long)]
    write_settings: bool,
    /// Settings for the board, instead of those that follow from the rig (see `hil-sim settings`)
    #[arg(long, value_name = "FILE")]
    settings: Option<PathBuf>,
    /// Print text instead of showing a screen
    #[arg(long)]
    no_screen: bool,
    /// Do not slow the emulated board down to real time for the screen
    #[arg(long)]
    fast: bool,
}

#[derive(Serialize)]
struct Summary {
    seed: u64,
    board: String,
    runs: Vec<RunSummary>,
}

#[derive(Serialize)]
struct RunSummary {
    name: String,
    tracking: Tracking,
    record: String,
    stopped: bool,
    board: BoardReport,
    /// Comparison with the same controller on this PC.
    differing_ticks: usize,
}

/// A run, and the report of its board.
struct Done {
    run: AssistRun,
    summary: RunSummary,
}

/// Runs the command.
pub fn run(args: &Args) -> Result<(), Failure> {
    let rig = args.common.rig()?;
    let experiment = args.scenario.experiment()?;
    let rigs = match args.common.is_reference() {
        true => Vec::from(valves(&rig)?),
        false => vec![("assist", rig)],
    };
    for (name, _) in &rigs {
        let record = args.common.results.out.join(super::record_name(name));
        args.scenario.refuse_overwriting(&record)?;
    }
    let mut board = connect(args.port.as_deref())?;
    let words = describe(&board.identity);
    super::note(format_args!("seed: {}", args.scenario.seed));
    super::note(format_args!("board: {words}"));
    let may_write = args.write_settings || args.port.is_none();
    let settings = match &args.settings {
        Some(file) => {
            let wanted = settings_file::read(file)?;
            ensure(&mut board.line, wanted, &board.port, "the file", may_write)?
        }
        None => ensure_from_rig(&mut board.line, &rigs[0].1, &board.port, may_write)?,
    };
    let with_screen =
        cfg!(feature = "terminal") && !args.no_screen && std::io::stderr().is_terminal();
    let view = Mutex::new(View::new(&words, board.identity.cpu_hz));
    let jobs: Vec<(&str, Job)> = rigs
        .iter()
        .map(|(name, rig)| {
            let job = Job {
                rig,
                settings,
                run: &experiment,
                progress: if with_screen {
                    no_progress
                } else {
                    print_tenths
                },
                real_time: with_screen && !args.fast && args.port.is_none(),
            };
            (*name, job)
        })
        .collect();
    let done = if with_screen {
        on_screen(args, &mut board, &view, &jobs)?
    } else {
        all(args, &mut board, &view, &jobs, true)?
    };
    let _ = board.line.leave();
    finish(args, words, done)
}

/// Prints no progress.
pub fn no_progress(_: &str, _: &Tick, _: f64) {}

/// Prints the state after each tenth of the run.
pub fn print_tenths(name: &str, tick: &Tick, duration_s: f64) {
    let tenth = |time_s: f64| (10.0 * time_s / duration_s).floor();
    if tenth(tick.time_s) < tenth(tick.time_s + TICK_S) {
        let (time_s, output) = (tick.time_s + TICK_S, &tick.output);
        let fault = output
            .fault
            .map_or(String::new(), |fault| format!(", {fault}"));
        let (mode, force_n) = (output.mode, tick.force_n);
        super::note(format_args!(
            "{name}: {time_s:.1} of {duration_s:.1} s, {mode}{fault}, {force_n:.0} N"
        ));
    }
}

/// Ends the screen when it is dropped, also if the run panics.
#[cfg(feature = "terminal")]
struct SetOnDrop<'a>(&'a AtomicBool);

#[cfg(feature = "terminal")]
impl Drop for SetOnDrop<'_> {
    fn drop(&mut self) {
        self.0.store(true, Ordering::Release);
    }
}

#[cfg(not(feature = "terminal"))]
fn on_screen(
    args: &Args,
    board: &mut Connected,
    view: &Mutex<View>,
    jobs: &[(&str, Job)],
) -> Result<Vec<Done>, Failure> {
    all(args, board, view, jobs, false)
}

/// Runs all jobs while the screen shows them.
#[cfg(feature = "terminal")]
fn on_screen(
    args: &Args,
    board: &mut Connected,
    view: &Mutex<View>,
    jobs: &[(&str, Job)],
) -> Result<Vec<Done>, Failure> {
    let ended = AtomicBool::new(false);
    let stop = std::sync::Arc::clone(&board.stop);
    let (done, shown) = std::thread::scope(|scope| {
        let jobs = scope.spawn(|| {
            let _ended = SetOnDrop(&ended);
            all(args, board, view, jobs, false)
        });
        let shown = screen::show(view, &stop, &ended);
        (jobs.join(), shown)
    });
    if let Err(error) = shown {
        eprintln!("no screen: {error}");
    }
    done.unwrap_or_else(|panic| std::panic::resume_unwind(panic))
}

fn all(
    args: &Args,
    board: &mut Connected,
    view: &Mutex<View>,
    jobs: &[(&str, Job)],
    prints_lines: bool,
) -> Result<Vec<Done>, Failure> {
    let mut done = Vec::new();
    for (name, job) in jobs {
        let one = one(args, board, view, name, job)?;
        let stopped = one.summary.stopped;
        if prints_lines {
            let lines = view.lock().map(|mut view| view.take_log());
            for line in lines.unwrap_or_default() {
                super::note(format_args!("{line}"));
            }
            super::note(format_args!("{}", one.run.verdict()));
        }
        done.push(one);
        if stopped {
            break;
        }
    }
    Ok(done)
}

fn one(
    args: &Args,
    board: &mut Connected,
    view: &Mutex<View>,
    name: &str,
    job: &Job,
) -> Result<Done, Failure> {
    let path = args.common.results.record_path(name)?;
    let origin = Origin {
        rig: Some(match args.common.is_reference() {
            true => format!("{}, {name}", args.common.rig_name()),
            false => args.common.rig_name(),
        }),
        seed: Some(job.run.seed),
        ..origin(board, job.settings.values())?
    };
    let recorder = Recorder::create(&path, &origin)?;
    let (ticks, report) = hil::run(&mut board.line, name, job, recorder, view)?;
    // Compares the board's record with the same controller on this PC.
    let record = Record::read(&path)?;
    let differing = replay(&Inputs::new(&record)?, &mut OnPc::default(), |_| {})?;
    let planned = (job.run.duration_s / TICK_S).round() as usize;
    let stopped = ticks.len() < planned;
    let run = AssistRun::new(name, job.rig, job.settings, job.run, ticks)?;
    let summary = RunSummary {
        name: name.into(),
        tracking: run.tracking,
        record: path.display().to_string(),
        stopped,
        board: report,
        differing_ticks: differing.differing_ticks,
    };
    Ok(Done { run, summary })
}

fn verdict(done: &Done) -> String {
    let (summary, report) = (&done.summary, &done.summary.board);
    let mut words = done.run.verdict();
    words += &format!(
        " {} of {} ticks differ from the same controller on this PC",
        summary.differing_ticks, report.ticks
    );
    if report.restarts > 0 {
        let restarts = report.restarts;
        words += &format!("; the board's controller restarted {restarts} times");
    }
    if summary.stopped {
        words += "; it was stopped early";
    }
    words + "."
}

fn board_table(done: &[Done]) -> Table {
    let row = |done: &Done| {
        let report = &done.summary.board;
        vec![
            done.summary.name.clone(),
            report.ticks.to_string(),
            report.missed_ticks.to_string(),
            format!("{} cycles", report.late_cycles_max),
            format!("{} cycles", report.busy_cycles_max),
            report.link.silent_ticks.to_string(),
            report.link.telemetry_lost.to_string(),
            report.link.frames_rejected.to_string(),
            report.restarts.to_string(),
        ]
    };
    Table {
        caption: "Board and link".into(),
        columns: [
            "run",
            "ticks",
            "missed",
            "latest start",
            "longest tick",
            "silent ticks",
            "lost frames",
            "bad frames",
            "restarts",
        ]
        .map(String::from)
        .into(),
        rows: done.iter().map(row).collect(),
    }
}

fn finish(args: &Args, board: String, done: Vec<Done>) -> Result<(), Failure> {
    let verdicts = done.iter().map(verdict).collect();
    let tables = board_table(&done);
    let (runs, summaries): (Vec<AssistRun>, Vec<RunSummary>) = done
        .into_iter()
        .map(|done| (done.run, done.summary))
        .unzip();
    let report = Report {
        title: "The assist experiment, hardware in the loop".into(),
        verdict: verdicts,
        sections: vec![Section {
            heading: "Runs".into(),
            text: vec![format!("The controller ran on: {board}.")],
            tables: vec![tracking_table(&runs), tables],
            plots: assist_plots(&runs),
            ..Section::default()
        }],
        repeat: Vec::new(),
    };
    let summary = Summary {
        seed: args.scenario.seed,
        board,
        runs: summaries,
    };
    args.common.results.finish(report, &summary)
}
