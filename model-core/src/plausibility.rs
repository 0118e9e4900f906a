//! Is one sensor's reading plausible? Range, step and standstill, and the last value that was good.

use crate::limits::RECOVERY_TICKS;
use serde::{Deserialize, Serialize};

/// What makes a reading implausible.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Doubt {
    /// At an end of the converter's scale (an open or shorted wire), or beyond physics.
    Range,
    /// Further from the last good value than physics allows.
    Step,
    /// The same for longer than its noise allows, or while what it measures must have moved.
    Stuck,
}

/// A sensor's status after a tick.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum SensorStatus {
    /// The reading is used.
    Good,
    /// The last good value is used, for a few ticks.
    Suspect,
    /// The reading was suspect for too long.
    Failed(Doubt),
}

/// Counts bad ticks. A good tick takes back a tenth of a bad one, so that an intermittent fault is
/// detected too.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct BadTickCount(u16);

impl BadTickCount {
    /// Counts one more tick.
    pub fn add(&mut self, bad: bool, limit: u8) {
        self.add_ticks(u16::from(bad), limit);
    }

    /// Counts one more tick, which stands for so many bad ones; for a good one if for none.
    pub fn add_ticks(&mut self, bad_ticks: u16, limit: u8) {
        self.0 = if bad_ticks > 0 {
            let more = bad_ticks.saturating_mul(RECOVERY_TICKS);
            self.0.saturating_add(more).min(full(limit))
        } else {
            self.0.saturating_sub(1)
        };
    }

    /// True if good ticks have taken back every bad one.
    pub fn is_empty(self) -> bool {
        self.0 == 0
    }

    /// True from the `limit`th bad tick (a later one with good ticks in between) to the next good
    /// tick.
    pub fn is_full(self, limit: u8) -> bool {
        self.0 >= full(limit)
    }
}

fn full(limit: u8) -> u16 {
    u16::from(limit).saturating_mul(RECOVERY_TICKS)
}

/// Monitors one sensor: its last good value, and how plausible its readings were lately.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct SensorMonitor {
    /// The last good value.
    value: f32,
    /// The last reading's counts, and how often in a row it was the same.
    counts: u32,
    same_ticks: u16,
    /// Ticks without a reading within its range, up to now.
    blind_ticks: f32,
    /// Implausible readings.
    suspects: BadTickCount,
    /// Whether there was a reading.
    begun: bool,
}

/// Bounds within which one reading is plausible.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Bounds {
    /// The reading is at an end of its scale, or beyond physics.
    pub out_of_range: bool,
    /// The reading stands still although what it measures must have moved.
    pub at_standstill: bool,
    /// Largest plausible change in one tick.
    pub step_max: f32,
    /// So many equal readings are a standstill; 0: never.
    pub stuck_ticks: u16,
    /// So many suspect readings in a row are a failure; more, with few good ones in between.
    pub suspect_ticks: u8,
    /// Ticks since the last reading.
    pub ticks: f32,
}

impl Bounds {
    /// What is implausible about a reading that differs by `step` from the last good one, after
    /// `blind_ticks` out of range, and that is equal to the one before for the `same_ticks`th time.
    fn doubt(&self, step: f32, blind_ticks: f32, same_ticks: u16) -> Option<Doubt> {
        // While the reading was out of range the quantity may have moved on. A reading that was
        // within range but rejected does not widen the bound: the quantity was not there.
        let step_max = self.step_max * (self.ticks + blind_ticks);
        let stuck = self.stuck_ticks > 0 && same_ticks >= self.stuck_ticks;
        // A step that is NaN is not within the bound either.
        let within_step = libm::fabsf(step) <= step_max;
        if self.out_of_range {
            Some(Doubt::Range)
        } else if !within_step {
            Some(Doubt::Step)
        } else if self.at_standstill || stuck {
            Some(Doubt::Stuck)
        } else {
            None
        }
    }
}

impl SensorMonitor {
    /// Whether there was a reading.
    pub fn has_begun(&self) -> bool {
        self.begun
    }

    /// The last good value.
    pub fn value(&self) -> f32 {
        self.value
    }

    /// The monitor after one more reading, and the sensor's status.
    pub(crate) fn next(
        self,
        counts: u32,
        value: f32,
        bounds: &Bounds,
    ) -> (SensorMonitor, SensorStatus) {
        let mut monitor = self;
        let same = self.begun && self.counts == counts;
        monitor.same_ticks = if same {
            self.same_ticks.saturating_add(1)
        } else {
            0
        };
        monitor.counts = counts;
        monitor.begun = true;
        let step = if self.begun { value - self.value } else { 0.0 };
        let doubt = bounds.doubt(step, self.blind_ticks, monitor.same_ticks);
        monitor.blind_ticks = if doubt == Some(Doubt::Range) {
            self.blind_ticks + bounds.ticks
        } else {
            0.0
        };
        monitor.suspects.add(doubt.is_some(), bounds.suspect_ticks);
        let Some(doubt) = doubt else {
            monitor.value = value;
            return (monitor, SensorStatus::Good);
        };
        if monitor.suspects.is_full(bounds.suspect_ticks) {
            (monitor, SensorStatus::Failed(doubt))
        } else {
            (monitor, SensorStatus::Suspect)
        }
    }
}
