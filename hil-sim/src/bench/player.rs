//! Plays an experiment's reference pressures on a board: what to ask for in each tick.

use crate::bench::closed_loop::TICK_S;
use crate::error::BadInput;
use crate::record::{PRESSURE_REF_PA, Record};
use model_core::io::{Output, Request};
use model_core::supervisor::{Fault, Mode};

/// A board that is ready and is asked begins in the next tick, unless the asking is lost: seconds.
const PATIENCE_TICKS: u32 = 500;

/// How far the reference may be from the pressure \[Pa\] behind a shut cock, and until they have
/// met again: less than half of what the controller takes for a valve that does not obey.
const COCK_BAND_PA: f64 = 4e4;

/// How an experiment ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum End {
    /// To its end, and vented.
    Played,
    /// With a fault, vented.
    Failed(Fault),
    /// Vented before its end: somebody pressed the button, or the link was silent.
    Vented,
    /// It did not begin, or the board began anew: it was in this mode.
    Refused(Mode),
}

/// An experiment that is played.
#[derive(Clone, Debug)]
pub struct Player {
    time_s: Vec<f64>,
    reference_pa: Vec<u32>,
    /// Where the cock between valve and muscle is to be shut; empty if nowhere.
    shut: Vec<bool>,
    /// It has been shut, and the pressure has not met the reference since.
    apart: bool,
    most_pa: u32,
    from_tick: Option<u32>,
    waited_ticks: u32,
    asked_to_vent: bool,
    end: Option<End>,
}

impl Player {
    /// Plays the `pressure_ref_pa` of a record, each from its row's time until the next's.
    ///
    /// # Errors
    /// The record lacks it, or asks for less than none.
    pub fn new(drive: &Record) -> Result<Player, BadInput> {
        let mut last_pa = 0;
        let mut reference_pa = Vec::new();
        for (value, time_s) in drive.require(PRESSURE_REF_PA)?.iter().zip(drive.time_s()) {
            if *value < 0.0 {
                let expected = format!("a gauge pressure from 0, found {value}");
                return Err(BadInput {
                    line: drive.bad_at(*time_s, "").line,
                    ..drive.bad(PRESSURE_REF_PA, &expected)
                });
            }
            // An empty cell: it is held.
            if !value.is_nan() {
                last_pa = value.round() as u32;
            }
            reference_pa.push(last_pa);
        }
        Ok(Player {
            time_s: drive.time_s().to_vec(),
            most_pa: reference_pa.iter().copied().max().unwrap_or(0),
            reference_pa,
            shut: drive.shut(),
            apart: false,
            from_tick: None,
            waited_ticks: 0,
            asked_to_vent: false,
            end: None,
        })
    }

    /// The highest pressure it asks for, gauge \[Pa\].
    pub fn pressure_pa_max(&self) -> f32 {
        self.most_pa as f32
    }

    /// The cock between valve and muscle is shut at some time.
    pub fn has_cock(&self) -> bool {
        !self.shut.is_empty()
    }

    /// How long it takes \[s\].
    pub fn length_s(&self) -> f64 {
        self.time_s[self.time_s.len() - 1] - self.time_s[0]
    }

    /// How it ended, once it has.
    pub fn end(&self) -> Option<End> {
        self.end
    }

    /// The row that is due at `tick`, if it has begun and not ended.
    fn row(&self, tick: u32) -> Option<usize> {
        let ticks = tick.wrapping_sub(self.from_tick?);
        let time_s = self.time_s[0] + f64::from(ticks) * TICK_S;
        // A row that is due now is not missed for a rounding error.
        let after = self.time_s.partition_point(|row_s| *row_s <= time_s + 1e-6);
        let over = time_s > self.time_s[self.time_s.len() - 1] + 1e-6;
        (!over).then(|| after.saturating_sub(1))
    }

    /// The cock between valve and muscle is to be shut from `tick` on.
    pub fn is_shut(&self, tick: u32) -> bool {
        let row = self.row(tick).and_then(|row| self.shut.get(row));
        row.copied().unwrap_or(false)
    }

    /// What to ask for in `row` \[Pa\]. Behind a shut cock the reference stays near the pressure,
    /// which may leak: the controller does not miss what it cannot reach, and little surges in
    /// where the cock opens. Nearer it must not come: as long as a hand is late the valve works,
    /// and would follow what the sensor is wrong by.
    fn asked_pa(&mut self, row: usize, output: &Output) -> u32 {
        let planned_pa = self.reference_pa[row];
        let read_pa = f64::from(output.pressure.0);
        let is_shut = self.shut.get(row).copied().unwrap_or(false);
        let is_near = (f64::from(planned_pa) - read_pa).abs() <= COCK_BAND_PA;
        self.apart = is_shut || self.apart && !is_near;
        if !self.apart || read_pa.is_nan() {
            return planned_pa;
        }
        let near_pa = f64::from(planned_pa).clamp(read_pa - COCK_BAND_PA, read_pa + COCK_BAND_PA);
        (near_pa.max(0.0).round() as u32).min(self.most_pa)
    }

    /// What to ask for after the tick that gave `output`. Ticks that were not seen take their time.
    pub fn request(&mut self, tick: u32, output: &Output) -> Request {
        match (output.mode, self.from_tick) {
            _ if self.end.is_some() => Request::None,
            (Mode::SelfCheck, None) => Request::None,
            (Mode::Ready, None) => {
                self.waited_ticks += 1;
                if self.waited_ticks > PATIENCE_TICKS {
                    self.end = Some(End::Refused(Mode::Ready));
                }
                Request::Play(self.reference_pa[0])
            }
            (Mode::Playing, _) => {
                self.from_tick.get_or_insert(tick);
                match self.row(tick.wrapping_add(1)) {
                    Some(row) => Request::Play(self.asked_pa(row, output)),
                    None => {
                        self.asked_to_vent = true;
                        Request::Vent
                    }
                }
            }
            (Mode::Venting, Some(_)) => {
                if output.pressure_ref.0 <= 0.0 {
                    self.end = Some(match output.fault {
                        Some(fault) => End::Failed(fault),
                        None if self.asked_to_vent => End::Played,
                        None => End::Vented,
                    });
                }
                Request::None
            }
            (mode, _) => {
                self.end = Some(End::Refused(mode));
                Request::None
            }
        }
    }
}
