//! Is a reading possible? Range, step and standstill of one sensor, and the last value that was.

use crate::safety::{SafetyFunction, Switches};
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

/// Good ticks that make up for a bad one.
const RECOVERY_TICKS: u16 = 10;

/// Counts bad ticks. Good ones in between make up for few: what comes and goes is noticed too.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Tally(u16);

impl Tally {
    /// One more tick.
    pub fn add(&mut self, bad: bool, limit: u8) {
        self.0 = if bad {
            self.0.saturating_add(RECOVERY_TICKS).min(full(limit))
        } else {
            self.0.saturating_sub(1)
        };
    }

    /// True where no bad tick is left.
    pub fn is_empty(self) -> bool {
        self.0 == 0
    }

    /// True from the `limit`th bad tick, with good ones in between a later one, to the next good.
    pub fn is_full(self, limit: u8) -> bool {
        self.0 >= full(limit)
    }
}

fn full(limit: u8) -> u16 {
    u16::from(limit).saturating_mul(RECOVERY_TICKS)
}

/// One sensor's recent past.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Watch {
    /// The last good value.
    value: f32,
    /// The last reading's counts, and how often in a row it was the same.
    counts: u32,
    same_ticks: u16,
    /// Ticks without a reading within its range, up to now.
    blind_ticks: f32,
    /// Readings that were not plausible.
    suspects: Tally,
    /// A first reading has come.
    begun: bool,
}

/// What a sensor is judged by.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Bounds {
    /// The reading is at an end of its scale, or physics ends before it.
    pub out_of_range: bool,
    /// The reading stands still although it must not.
    pub at_standstill: bool,
    /// Largest plausible change in one tick.
    pub step_max: f32,
    /// So many equal readings are a standstill; 0: never.
    pub stuck_ticks: u16,
    /// So many suspect readings in a row are a failure; more, with few good ones in between.
    pub suspect_ticks: u8,
    /// Ticks since the last reading.
    pub ticks: f32,
    /// What is looked at.
    pub switches: Switches,
}

impl Bounds {
    /// What is wrong with a reading that is `step` away from the last good one, `blind_ticks` and
    /// one ago, and the same for the `same_ticks`th time.
    fn doubt(&self, step: f32, blind_ticks: f32, same_ticks: u16) -> Option<Doubt> {
        let looked_at = |function| self.switches.on(function);
        // What was not seen may have moved on; what was seen elsewhere has not come there.
        let step_max = self.step_max * (self.ticks + blind_ticks);
        let stuck = self.stuck_ticks > 0 && same_ticks >= self.stuck_ticks;
        if self.out_of_range && looked_at(SafetyFunction::SensorRange) {
            Some(Doubt::Range)
        } else if !(step <= step_max && step >= -step_max) && looked_at(SafetyFunction::SensorStep)
        {
            Some(Doubt::Step)
        } else if (self.at_standstill || stuck) && looked_at(SafetyFunction::SensorStuck) {
            Some(Doubt::Stuck)
        } else {
            None
        }
    }
}

impl Watch {
    /// The last good value.
    pub fn value(&self) -> f32 {
        self.value
    }

    /// The past with one more reading, and what is thought of the sensor.
    pub(crate) fn next(self, counts: u32, value: f32, bounds: &Bounds) -> (Watch, Verdict) {
        let mut watch = self;
        let same = self.begun && self.counts == counts;
        watch.same_ticks = if same {
            self.same_ticks.saturating_add(1)
        } else {
            0
        };
        watch.counts = counts;
        watch.begun = true;
        let step = if self.begun { value - self.value } else { 0.0 };
        let doubt = bounds.doubt(step, self.blind_ticks, watch.same_ticks);
        watch.blind_ticks = if doubt == Some(Doubt::Range) {
            self.blind_ticks + bounds.ticks
        } else {
            0.0
        };
        watch.suspects.add(doubt.is_some(), bounds.suspect_ticks);
        let Some(doubt) = doubt else {
            watch.value = value;
            return (watch, Verdict::Good);
        };
        if watch.suspects.is_full(bounds.suspect_ticks) {
            (watch, Verdict::Failed(doubt))
        } else {
            (watch, Verdict::Suspect)
        }
    }
}
