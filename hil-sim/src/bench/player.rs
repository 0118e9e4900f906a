//! Plays a test signal's reference pressures on a board: the request for each tick.

use crate::bench::tick::TICK_S;
use crate::error::BadInput;
use crate::record::{PRESSURE_REF_PA, Record};
use model_core::io::{Output, Request};
use model_core::supervisor::{Fault, Mode};

/// Ticks after which a ready board that has not started is given up: a board starts in the tick
/// after the request, unless the request is lost on the link.
const START_TICKS_MAX: u32 = 500;

/// Largest distance of the reference from the pressure \[Pa\] while the shut-off valve is shut, and
/// until both have met again: less than half of the difference at which the controller reports a
/// valve that does not follow.
const SHUTOFF_BAND_PA: f64 = 4e4;

/// How the playing of a test signal ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum End {
    /// Played to its end, and vented.
    Played,
    /// Stopped by a fault, and vented.
    Failed(Fault),
    /// Vented before its end: by the button, or after silence on the link.
    Vented,
    /// Not started, or stopped by a restart of the board, which was in this mode.
    Refused(Mode),
}

/// A test signal while it is played.
#[derive(Clone, Debug)]
pub struct Player {
    time_s: Vec<f64>,
    reference_pa: Vec<u32>,
    /// For each row, whether the shut-off valve between valve and muscle is to be shut; empty if it
    /// never is.
    shut: Vec<bool>,
    /// The shut-off valve has been shut, and the pressure has not met the reference since.
    apart: bool,
    highest_pa: u32,
    first_tick: Option<u32>,
    waited_ticks: u32,
    asked_to_vent: bool,
    end: Option<End>,
}

impl Player {
    /// Plays the `pressure_ref_pa` of a record, each value from its row's time until the next
    /// row's.
    ///
    /// # Errors
    /// The record lacks this column, or a value is negative.
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
            // An empty cell holds the value before it.
            if !value.is_nan() {
                last_pa = value.round() as u32;
            }
            reference_pa.push(last_pa);
        }
        Ok(Player {
            time_s: drive.time_s().to_vec(),
            highest_pa: reference_pa.iter().copied().max().unwrap_or(0),
            reference_pa,
            shut: drive.shut(),
            apart: false,
            first_tick: None,
            waited_ticks: 0,
            asked_to_vent: false,
            end: None,
        })
    }

    /// The highest pressure of the test signal, gauge \[Pa\].
    pub fn pressure_pa_max(&self) -> f32 {
        self.highest_pa as f32
    }

    /// True if the shut-off valve between valve and muscle is to be shut at some time.
    pub fn has_shutoff(&self) -> bool {
        !self.shut.is_empty()
    }

    /// Duration \[s\].
    pub fn length_s(&self) -> f64 {
        self.time_s[self.time_s.len() - 1] - self.time_s[0]
    }

    /// How playing ended; none while it goes on.
    pub fn end(&self) -> Option<End> {
        self.end
    }

    /// The row that is due at `tick`; none before the start and after the end.
    fn row(&self, tick: u32) -> Option<usize> {
        let ticks = tick.wrapping_sub(self.first_tick?);
        let time_s = self.time_s[0] + f64::from(ticks) * TICK_S;
        // A row that is due now must not be missed because of rounding.
        let after = self.time_s.partition_point(|row_s| *row_s <= time_s + 1e-6);
        let over = time_s > self.time_s[self.time_s.len() - 1] + 1e-6;
        (!over).then(|| after.saturating_sub(1))
    }

    /// True if the shut-off valve between valve and muscle is to be shut from `tick` on.
    pub fn is_shut(&self, tick: u32) -> bool {
        let row = self.row(tick).and_then(|row| self.shut.get(row));
        row.copied().unwrap_or(false)
    }

    /// The reference pressure for `row` \[Pa\]. While the shut-off valve is shut, the reference
    /// stays within a band around the measured pressure, which may leak away: the controller then
    /// reports no deviation, and only little air flows when the shut-off valve opens. The reference
    /// does not follow the measured pressure itself: while the user has not yet shut the valve by
    /// hand, the proportional valve would follow the sensor's error.
    fn request_pa(&mut self, row: usize, output: &Output) -> u32 {
        let planned_pa = self.reference_pa[row];
        let measured_pa = f64::from(output.pressure.0);
        let is_shut = self.shut.get(row).copied().unwrap_or(false);
        let is_near = (f64::from(planned_pa) - measured_pa).abs() <= SHUTOFF_BAND_PA;
        self.apart = is_shut || self.apart && !is_near;
        if !self.apart || measured_pa.is_nan() {
            return planned_pa;
        }
        let near_pa = f64::from(planned_pa)
            .clamp(measured_pa - SHUTOFF_BAND_PA, measured_pa + SHUTOFF_BAND_PA);
        (near_pa.max(0.0).round() as u32).min(self.highest_pa)
    }

    /// The request after the tick that gave `output`. Ticks that were not seen count as played.
    pub fn request(&mut self, tick: u32, output: &Output) -> Request {
        match (output.mode, self.first_tick) {
            _ if self.end.is_some() => Request::None,
            (Mode::SelfCheck, None) => Request::None,
            (Mode::Ready, None) => {
                self.waited_ticks += 1;
                if self.waited_ticks > START_TICKS_MAX {
                    self.end = Some(End::Refused(Mode::Ready));
                }
                Request::Play(self.reference_pa[0])
            }
            (Mode::Playing, _) => {
                self.first_tick.get_or_insert(tick);
                match self.row(tick.wrapping_add(1)) {
                    Some(row) => Request::Play(self.request_pa(row, output)),
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
