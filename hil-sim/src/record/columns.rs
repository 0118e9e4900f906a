//! The columns of a record of a controller's ticks: each one's name, and its value in a row.

use crate::record::{self, Record};
use model_core::io::{Output, Sensors};
use model_core::link::Source;
use model_core::settings::{ENCODED_LEN_MAX, Settings};
use model_core::timing::Timing;
use std::fmt::Write as _;

/// One tick of a controller.
#[derive(Clone, Copy, Debug)]
pub struct Row {
    /// Time of sampling \[s\].
    pub time_s: f64,
    /// Reference pressure sent to the valve, rounded to DAC counts \[Pa\].
    pub pressure_ref_pa: f64,
    /// While a test signal is played: whether the shut-off valve between valve and muscle is to be
    /// shut.
    pub shut: Option<bool>,
    /// The controller's input.
    pub sensors: Sensors,
    /// The controller's output.
    pub output: Output,
    /// With a simulated plant: muscle force \[N\] and finger displacement \[m\].
    pub plant: Option<(f64, f64)>,
    /// With a board: its tick, the source of its input, and its timing.
    pub board: Option<(u32, Source, Timing)>,
    /// In the first tick after a start of the controller: its settings.
    pub start_settings: Option<Settings>,
}

/// One value of a row.
#[derive(Clone, Debug, PartialEq)]
pub enum Cell {
    /// No value.
    Missing,
    /// A number.
    Number(f64),
    /// A word.
    Text(String),
}

/// A column: its name, whether it holds text, and its value in a row.
pub type Column = (&'static str, bool, fn(&Row) -> Cell);

fn maybe(value: Option<f64>) -> Cell {
    value.map_or(Cell::Missing, Cell::Number)
}

/// `settings` as they are stored in flash, in hexadecimal digits.
fn hex(settings: &Settings) -> String {
    let mut buffer = [0; ENCODED_LEN_MAX];
    let mut digits = String::new();
    // The buffer is long enough for any settings.
    for byte in settings.encode(&mut buffer).unwrap_or_default() {
        let _ = write!(digits, "{byte:02x}");
    }
    digits
}

/// The columns of a record of ticks, in the file's order.
pub const COLUMNS: [Column; 23] = [
    (record::TIME_S, false, |row| Cell::Number(row.time_s)),
    (record::PRESSURE_REF_PA, false, |row| {
        Cell::Number(row.pressure_ref_pa)
    }),
    (record::VALVE_OPEN, false, |row| {
        maybe(row.shut.map(|shut| f64::from(!shut)))
    }),
    (record::PRESSURE_PA, false, |row| {
        Cell::Number(row.output.pressure.0.into())
    }),
    (record::CONTRACTION, false, |row| {
        Cell::Number(row.output.contraction.into())
    }),
    (record::FORCE_N, false, |row| {
        maybe(row.plant.map(|(force_n, _)| force_n))
    }),
    (record::FINGER_M, false, |row| {
        maybe(row.plant.map(|(_, finger_m)| finger_m))
    }),
    (record::INPUT_FORCE_N, false, |row| {
        Cell::Number(row.output.finger_force_n.into())
    }),
    (record::REFERENCE_FORCE_N, false, |row| {
        Cell::Number(row.output.reference_force_n.into())
    }),
    (record::MODE, true, |row| {
        Cell::Text(row.output.mode.name().into())
    }),
    (record::FAULT, true, |row| match row.output.fault {
        None => Cell::Missing,
        Some(fault) => Cell::Text(fault.name().into()),
    }),
    (record::BRIDGE_COUNT, false, |row| {
        Cell::Number(row.sensors.bridge.0.into())
    }),
    (record::PRESSURE_COUNT, false, |row| {
        Cell::Number(row.sensors.pressure.0.into())
    }),
    (record::ENCODER_COUNT, false, |row| {
        Cell::Number(row.sensors.encoder.0.into())
    }),
    (record::MISSED_TICKS, false, |row| {
        Cell::Number(row.sensors.missed_ticks.into())
    }),
    (record::REQUEST, true, |row| {
        Cell::Text(row.sensors.request.to_string())
    }),
    (record::VALVE_COUNT, false, |row| {
        Cell::Number(row.output.valve.get().into())
    }),
    (record::EXACT_PRESSURE_REF_PA, false, |row| {
        Cell::Number(row.output.pressure_ref.0.into())
    }),
    (record::TICK, false, |row| {
        maybe(row.board.map(|(tick, ..)| tick.into()))
    }),
    (record::SOURCE, true, |row| match row.board {
        None => Cell::Missing,
        Some((_, Source::Pins, _)) => Cell::Text("Pins".into()),
        Some((_, Source::Link(_), _)) => Cell::Text("Link".into()),
        Some((_, Source::Silence, _)) => Cell::Text("Silence".into()),
    }),
    (record::LATE_CYCLES, false, |row| {
        maybe(row.board.map(|(.., timing)| timing.late_cycles.into()))
    }),
    (record::BUSY_CYCLES, false, |row| {
        maybe(row.board.map(|(.., timing)| timing.busy_cycles.into()))
    }),
    (record::SETTINGS, true, |row| {
        row.start_settings
            .as_ref()
            .map_or(Cell::Missing, |settings| Cell::Text(hex(settings)))
    }),
];

/// The record of `rows`, without columns that have no value in any row.
///
/// # Panics
/// If there are no rows, or their times do not rise.
pub fn record(rows: &[Row]) -> Record {
    let mut record = Record::new(rows.iter().map(|row| row.time_s).collect());
    for (name, is_text, value) in &COLUMNS[1..] {
        let cells: Vec<Cell> = rows.iter().map(value).collect();
        if cells.iter().all(|cell| *cell == Cell::Missing) && *name != record::FAULT {
            continue;
        }
        if *is_text {
            let words = cells.into_iter().map(|cell| match cell {
                Cell::Text(word) => word,
                _ => String::new(),
            });
            record.set_text(name, words.collect());
        } else {
            let numbers = cells.into_iter().map(|cell| match cell {
                Cell::Number(number) => number,
                _ => f64::NAN,
            });
            record.set(name, numbers.collect());
        }
    }
    record
}
