//! Is a reading possible? Range, step and standstill of one sensor, and the last value that was.

use serde::{Deserialize, Serialize};

/// What makes a reading implausible.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Doubt {
    /// At an end of the converter's scale: an open or shorted wire.
    Range,
    /// Further from the last good value than physics allows.
    Step,
    /// The same for longer than its noise allows, or while what it measures must have moved.
    Stuck,
}

/// What is thought of a sensor after a tick.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Verdict {
    /// The reading is used.
    Good,
    /// The last good value is used, for a few ticks.
    Suspect,
    /// It was suspect for too long.
    Failed(Doubt),
}

/// What an implausible reading adds to the strikes, of which a plausible one takes one away.
const STRIKE: u8 = 5;
/// So many strikes are a failure: a sensor wrong in more than one of six readings comes here, one
/// that is wrong a few times in a second does not.
const STRIKES_MAX: u8 = 50;

/// One sensor's recent past.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Watch {
    /// The last good value.
    value: f32,
    /// The last reading's counts, and how often in a row it was the same.
    counts: u32,
    same_ticks: u16,
    /// Readings in a row that were not plausible.
    suspect_ticks: u8,
    /// Rises with each reading that was not plausible, falls with each that was.
    strikes: u8,
    /// A first reading has come.
    begun: bool,
}

/// What a sensor is judged by.
#[derive(Clone, Copy, Debug)]
pub struct Bounds {
    /// The reading is at an end of its scale.
    pub at_rail: bool,
    /// The reading stands still although it must not.
    pub at_standstill: bool,
    /// Largest plausible change in one tick.
    pub step_max: f32,
    /// So many equal readings are a standstill; 0: never.
    pub stuck_ticks: u16,
    /// So many suspect readings are a failure.
    pub suspect_ticks: u8,
    /// Ticks since the last reading.
    pub ticks: f32,
}

impl Watch {
    /// The last good value.
    pub fn value(&self) -> f32 {
        self.value
    }

    /// True where `counts` differ from the last reading's.
    pub fn moves(&self, counts: u32) -> bool {
        self.begun && self.counts != counts
    }

    /// The past with one more reading, and what is thought of the sensor.
    pub fn next(self, counts: u32, value: f32, bounds: &Bounds) -> (Watch, Verdict) {
        let mut watch = self;
        let same = self.begun && self.counts == counts;
        watch.same_ticks = if same {
            self.same_ticks.saturating_add(1)
        } else {
            0
        };
        watch.counts = counts;
        watch.begun = true;
        // A value that was bridged may have moved on all the while.
        let step_max = bounds.step_max * (bounds.ticks + self.suspect_ticks as f32);
        let step = value - self.value;
        let doubt = if bounds.at_rail {
            Some(Doubt::Range)
        } else if self.begun && !(step <= step_max && step >= -step_max) {
            Some(Doubt::Step)
        } else if bounds.at_standstill
            || (bounds.stuck_ticks > 0 && watch.same_ticks >= bounds.stuck_ticks)
        {
            Some(Doubt::Stuck)
        } else {
            None
        };
        let Some(doubt) = doubt else {
            watch.value = value;
            watch.suspect_ticks = 0;
            watch.strikes = self.strikes.saturating_sub(1);
            return (watch, Verdict::Good);
        };
        watch.suspect_ticks = self.suspect_ticks.saturating_add(1);
        watch.strikes = self.strikes.saturating_add(STRIKE);
        if watch.suspect_ticks >= bounds.suspect_ticks || watch.strikes >= STRIKES_MAX {
            (watch, Verdict::Failed(doubt))
        } else {
            (watch, Verdict::Suspect)
        }
    }
}
