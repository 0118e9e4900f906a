//! Hardware in the loop: the closed loop with the plant in this program and the controller on a
//! board, tick by tick over the link.
//!
//! The plant waits for the board: a tick that comes late slows the run down and does not change it.

use crate::bench::board_report::BoardReport;
use crate::bench::closed_loop::{Run, run_on};
use crate::bench::error::Error;
use crate::bench::port::ControllerPort;
use crate::bench::port::client::{Answer, Client, LinkError, Transport};
use crate::bench::recorder::Recorder;
use crate::bench::tick::Tick;
use crate::bench::view::View;
use crate::record::columns::Row;
use crate::rig::Rig;
use model_core::io::{Output, Sensors};
use model_core::settings::Settings;
use std::sync::Mutex;
use std::time::{Duration, Instant};

/// A run to be executed with hardware in the loop.
pub struct Job<'a> {
    /// The rig whose plant is simulated.
    pub rig: &'a Rig,
    /// The board's settings.
    pub settings: Settings,
    /// The run.
    pub run: &'a Run,
    /// Slow an emulated board down to real time, for the screen.
    pub real_time: bool,
    /// Called after each tick with the name of the run, the tick and the duration \[s\].
    pub progress: fn(&str, &Tick, f64),
}

/// A board as the controller of a run.
struct BoardController<'a, P> {
    client: &'a mut Client<P>,
    name: &'a str,
    job: &'a Job<'a>,
    recorder: &'a mut Recorder,
    view: &'a Mutex<View>,
    answer: Option<Answer>,
    starts: bool,
    ticks: Vec<Tick>,
    report: BoardReport,
    real_time_from: Option<Instant>,
}

impl<P: Transport> ControllerPort for BoardController<'_, P> {
    type Error = Error;

    fn tick(&mut self, sensors: &Sensors) -> Result<Output, Error> {
        let answer = self.client.exchange(sensors)?;
        self.report.add(&answer);
        self.answer = Some(answer);
        Ok(answer.output)
    }

    fn observe(&mut self, tick: Tick) -> Result<(), Error> {
        let answer = self.answer.take();
        let telemetry = answer.and_then(|answer| answer.telemetry);
        let restarted = answer.is_some_and(|answer| answer.restarted);
        let starts = std::mem::take(&mut self.starts) || restarted;
        self.recorder.push(&Row {
            board: telemetry.map(|telemetry| (telemetry.tick, telemetry.source, telemetry.timing)),
            start_settings: starts.then_some(self.job.settings),
            ..tick.row()
        })?;
        self.report.link = self.client.counts();
        let log = self.client.take_log();
        if let Ok(mut view) = self.view.lock() {
            view.ticks.push(tick);
            view.report = self.report;
            view.answered_at = Some(Instant::now());
            view.timing = telemetry.map(|telemetry| telemetry.timing).or(view.timing);
            view.log(log);
        }
        (self.job.progress)(self.name, &tick, self.job.run.duration_s);
        self.ticks.push(tick);
        if let Some(from) = self.real_time_from {
            let due = from + Duration::from_secs_f64(tick.time_s);
            std::thread::sleep(due.saturating_duration_since(Instant::now()));
        }
        Ok(())
    }
}

/// Executes the run of `job` under the given name, writes its record, and shows it in `view`. If
/// the user stops it, the ticks so far are the result.
///
/// # Errors
/// The board no longer answers, the plant has no solution, or the record cannot be written; the
/// record then holds the ticks so far.
pub fn run<P: Transport>(
    client: &mut Client<P>,
    name: &str,
    job: &Job,
    mut recorder: Recorder,
    view: &Mutex<View>,
) -> Result<(Vec<Tick>, BoardReport), Error> {
    if let Ok(mut view) = view.lock() {
        view.begin(name, job.run.duration_s);
    }
    client.restart_in_loop()?;
    let mut board = BoardController {
        client,
        name,
        job,
        recorder: &mut recorder,
        view,
        answer: None,
        starts: true,
        ticks: Vec::new(),
        report: BoardReport::default(),
        real_time_from: job.real_time.then(Instant::now),
    };
    let ran = run_on(job.rig, &job.settings, job.run, &mut board);
    let (ticks, report) = (board.ticks, board.report);
    recorder.finish()?;
    match ran {
        Err(Error::Link(LinkError::Stopped)) if !ticks.is_empty() => {}
        ran => ran?,
    }
    Ok((ticks, report))
}
