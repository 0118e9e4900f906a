//! Counts of a board and its link over a run.

use super::port::client::{Answer, LinkCounts};
use model_core::link::Telemetry;
use serde::Serialize;

/// Counts of a board and its link over a run.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct BoardReport {
    /// Ticks of the controller.
    pub ticks: usize,
    /// Restarts of the controller during the run, after a reset or silence on the link.
    pub restarts: usize,
    /// Ticks that the board has missed.
    pub missed_ticks: u64,
    /// The latest start of a tick \[CPU cycles\].
    pub late_cycles_max: u32,
    /// The longest tick \[CPU cycles\].
    pub busy_cycles_max: u32,
    /// Errors on the line.
    pub link: LinkCounts,
}

impl BoardReport {
    pub(super) fn add(&mut self, answer: &Answer) {
        self.ticks += 1;
        self.restarts += usize::from(answer.restarted);
        if let Some(Telemetry { timing, .. }) = answer.telemetry {
            self.missed_ticks += u64::from(timing.missed_ticks);
            self.late_cycles_max = self.late_cycles_max.max(timing.late_cycles);
            self.busy_cycles_max = self.busy_cycles_max.max(timing.busy_cycles);
        }
    }
}
