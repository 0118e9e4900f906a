//! The state of a run with hardware in the loop, as the screen shows it.

use super::board_report::BoardReport;
use super::tick::Tick;
use model_core::timing::Timing;
use std::time::Instant;

/// Log lines that are kept.
const LOG_LINES: usize = 100;

/// The shown state.
#[derive(Clone, Default)]
pub struct View {
    /// Ticks so far.
    pub ticks: Vec<Tick>,
    /// Counts of the board and the link.
    pub report: BoardReport,
    /// Timing of the last tick.
    pub timing: Option<Timing>,
    /// When the board last answered.
    pub answered_at: Option<Instant>,
    /// Name of the board.
    pub board: String,
    /// CPU cycles of the board per microsecond.
    pub cycles_per_us: f64,
    /// Name of the run.
    pub run: String,
    /// Duration of the run \[s\].
    pub duration_s: f64,
    /// The last lines of the log.
    pub log: Vec<String>,
}

impl View {
    /// An empty view of the board named `board`.
    pub fn new(board: &str, cpu_hz: u32) -> View {
        View {
            board: board.into(),
            cycles_per_us: f64::from(cpu_hz) * 1e-6,
            ..View::default()
        }
    }

    /// Clears the view for the run named `run`.
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

    /// Takes the log's lines out of the view.
    pub fn take_log(&mut self) -> Vec<String> {
        std::mem::take(&mut self.log)
    }
}
