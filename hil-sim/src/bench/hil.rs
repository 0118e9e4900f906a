//! Hardware in the loop: the assist experiment with the plant here and the controller on a board,
//! tick by tick over the link.
//!
//! The plant waits for the board: a tick that comes late makes the experiment slower, not wrong.

use crate::bench::board_report::BoardReport;
use crate::bench::closed_loop::{self, Experiment, Tick, Ticker};
use crate::bench::link::{Answer, Client, LinkError, Port};
use crate::bench::recorder::{Recorder, Row};
use crate::bench::view::View;
use crate::error::BadInput;
use crate::output::NotWritten;
use crate::rig::Rig;
use model_core::io::{Output, Sensors};
use model_core::settings::Settings;
use std::sync::Mutex;
use std::time::{Duration, Instant};

/// Why an experiment did not come to its end.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// The board.
    #[error(transparent)]
    Link(#[from] LinkError),
    /// The rig.
    #[error(transparent)]
    Input(#[from] BadInput),
    /// The record.
    #[error(transparent)]
    NotWritten(#[from] NotWritten),
}

/// What is to be run.
pub struct Job<'a> {
    /// The plant.
    pub rig: &'a Rig,
    /// The board's settings.
    pub settings: Settings,
    /// What the hand does.
    pub experiment: &'a Experiment,
    /// Wait for real time, for those who watch an emulated board.
    pub real_time: bool,
    /// Told of the experiment's name, each tick, and the duration \[s\].
    pub progress: fn(&str, &Tick, f64),
}

/// The board as the experiment's controller.
struct InTheLoop<'a, P> {
    client: &'a mut Client<P>,
    name: &'a str,
    job: &'a Job<'a>,
    recorder: &'a mut Recorder,
    view: &'a Mutex<View>,
    answer: Option<Answer>,
    begins: bool,
    ticks: Vec<Tick>,
    report: BoardReport,
    real_time_from: Option<Instant>,
}

impl<P: Port> Ticker for InTheLoop<'_, P> {
    type Error = Error;

    fn tick(&mut self, sensors: &Sensors) -> Result<Output, Error> {
        let answer = self.client.exchange(sensors)?;
        self.report.add(&answer);
        self.answer = Some(answer);
        Ok(answer.output)
    }

    fn seen(&mut self, tick: Tick) -> Result<(), Error> {
        let answer = self.answer.take();
        let telemetry = answer.and_then(|answer| answer.telemetry);
        let began_anew = answer.is_some_and(|answer| answer.began_anew);
        let begins = std::mem::take(&mut self.begins) || began_anew;
        self.recorder.push(&Row {
            board: telemetry.map(|told| (told.tick, told.source, told.timing)),
            begins_with: begins.then_some(self.job.settings),
            ..tick.row()
        })?;
        self.report.link = self.client.counts();
        let log = self.client.take_log();
        if let Ok(mut view) = self.view.lock() {
            view.ticks.push(tick);
            view.report = self.report;
            view.told_at = Some(Instant::now());
            view.timing = telemetry.map(|told| told.timing).or(view.timing);
            view.log(log);
        }
        (self.job.progress)(self.name, &tick, self.job.experiment.duration_s);
        self.ticks.push(tick);
        if let Some(from) = self.real_time_from {
            let due = from + Duration::from_secs_f64(tick.time_s);
            std::thread::sleep(due.saturating_duration_since(Instant::now()));
        }
        Ok(())
    }
}

/// Runs the experiment `name`, writes its record, and shows it in `view`. One that the user stops
/// ends there.
///
/// # Errors
/// The board does not answer any more, or the plant or the record has failed; then the record
/// holds what was before.
pub fn run<P: Port>(
    client: &mut Client<P>,
    name: &str,
    job: &Job,
    mut recorder: Recorder,
    view: &Mutex<View>,
) -> Result<(Vec<Tick>, BoardReport), Error> {
    if let Ok(mut view) = view.lock() {
        view.begin(name, job.experiment.duration_s);
    }
    client.begin_anew()?;
    let mut board = InTheLoop {
        client,
        name,
        job,
        recorder: &mut recorder,
        view,
        answer: None,
        begins: true,
        ticks: Vec::new(),
        report: BoardReport::default(),
        real_time_from: job.real_time.then(Instant::now),
    };
    let ran = closed_loop::run_with(job.rig, &job.settings, job.experiment, &mut board);
    let (ticks, report) = (board.ticks, board.report);
    recorder.finish()?;
    match ran {
        Err(Error::Link(LinkError::Stopped)) if !ticks.is_empty() => {}
        ran => ran?,
    }
    Ok((ticks, report))
}
