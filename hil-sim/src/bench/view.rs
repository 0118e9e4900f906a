//! What a person sees of an experiment with hardware in the loop, while it runs.

use super::board_report::BoardReport;
use super::closed_loop::Tick;
use model_core::timing::Timing;
use std::time::Instant;

/// Log lines that are kept.
const LOG_LINES: usize = 100;

/// What is shown.
#[derive(Clone, Default)]
pub struct View {
    /// Ticks so far.
    pub ticks: Vec<Tick>,
    /// How the board fares.
    pub report: BoardReport,
    /// The last tick's.
    pub timing: Option<Timing>,
    /// When the board answered last.
    pub told_at: Option<Instant>,
    /// The board, as it names itself.
    pub board: String,
    /// Its CPU cycles in a microsecond.
    pub cycles_per_us: f64,
    /// Name of the run.
    pub run: String,
    /// Duration of the run \[s\].
    pub duration_s: f64,
    /// The last lines of the log.
    pub log: Vec<String>,
}

impl View {
    /// Nothing yet, of a board that says it is `board`.
    pub fn new(board: &str, cpu_hz: u32) -> View {
        View {
            board: board.into(),
            cycles_per_us: f64::from(cpu_hz) * 1e-6,
            ..View::default()
        }
    }

    /// Clears the screen for the experiment `run`.
    pub fn begin(&mut self, run: &str, duration_s: f64) {
        self.run = run.into();
        self.duration_s = duration_s;
        self.ticks.clear();
        self.report = BoardReport::default();
        self.timing = None;
    }

    /// Adds lines of the log.
    pub fn log(&mut self, lines: Vec<String>) {
        self.log.extend(lines);
        let surplus = self.log.len().saturating_sub(LOG_LINES);
        self.log.drain(..surplus);
    }

    /// The log's lines, which are then forgotten.
    pub fn take_log(&mut self) -> Vec<String> {
        std::mem::take(&mut self.log)
    }
}
