//! The columns of a record of a controller's ticks: name, unit, description, and value in a row.

use crate::record::{self, Record};
use model_core::io::{Output, Sensors};
use model_core::link::{Identity, Source};
use model_core::settings::{ENCODED_LEN_MAX, Settings};
use model_core::timing::Timing;
use std::fmt::{self, Display, Formatter, Write as _};

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
    /// In a record's first row: the programs that have made it.
    pub software: Option<Software>,
}

/// The programs that make a record: this one and, with a board, its firmware.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Software {
    /// The board's firmware.
    pub firmware: Option<Firmware>,
}

impl Display for Software {
    fn fmt(&self, out: &mut Formatter<'_>) -> fmt::Result {
        write!(out, "hil-sim {}", env!("CARGO_PKG_VERSION"))?;
        match self.firmware {
            None => Ok(()),
            Some(firmware) => write!(out, ", {firmware}"),
        }
    }
}

/// The firmware of a board, as it identifies itself.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Firmware {
    /// Major, minor and patch.
    pub version: [u8; 3],
    /// First eight digits of the commit; 0 if it is not known.
    pub commit: u32,
}

impl From<&Identity> for Firmware {
    fn from(identity: &Identity) -> Firmware {
        Firmware {
            version: identity.firmware,
            commit: identity.commit,
        }
    }
}

impl Display for Firmware {
    fn fmt(&self, out: &mut Formatter<'_>) -> fmt::Result {
        let [major, minor, patch] = self.version;
        write!(out, "firmware {major}.{minor}.{patch}")?;
        match self.commit {
            0 => Ok(()),
            commit => write!(out, " ({commit:08x})"),
        }
    }
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

/// A column of a record of ticks.
#[derive(Clone, Copy)]
pub struct Column {
    /// Its name.
    pub name: &'static str,
    /// The unit of its numbers; `None` if it holds text.
    pub unit: Option<&'static str>,
    /// What it holds.
    pub description: &'static str,
    /// Its value in a row.
    pub value: fn(&Row) -> Cell,
}

/// A column of numbers.
const fn number(
    name: &'static str,
    unit: &'static str,
    description: &'static str,
    value: fn(&Row) -> Cell,
) -> Column {
    Column {
        name,
        unit: Some(unit),
        description,
        value,
    }
}

/// A column of text.
const fn text(name: &'static str, description: &'static str, value: fn(&Row) -> Cell) -> Column {
    Column {
        name,
        unit: None,
        description,
        value,
    }
}

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
pub const COLUMNS: [Column; 26] = [
    number(record::TIME_S, "s", "Time of the sample", |row| {
        Cell::Number(row.time_s)
    }),
    number(
        record::PRESSURE_REF_PA,
        "Pa",
        "Reference pressure sent to the valve (gauge), held until the next row",
        |row| Cell::Number(row.pressure_ref_pa),
    ),
    number(
        record::VALVE_OPEN,
        "1",
        "1 if the shut-off valve is open, 0 if it is to be shut",
        |row| maybe(row.shut.map(|shut| f64::from(!shut))),
    ),
    number(
        record::PRESSURE_PA,
        "Pa",
        "Measured muscle pressure (gauge)",
        |row| Cell::Number(row.output.pressure.0.into()),
    ),
    number(record::CONTRACTION, "1", "Measured contraction", |row| {
        Cell::Number(row.output.contraction.into())
    }),
    number(record::FORCE_N, "N", "Muscle force", |row| {
        maybe(row.plant.map(|(force_n, _)| force_n))
    }),
    number(record::FINGER_M, "m", "Finger displacement", |row| {
        maybe(row.plant.map(|(_, finger_m)| finger_m))
    }),
    number(record::INPUT_FORCE_N, "N", "Finger force", |row| {
        Cell::Number(row.output.finger_force_n.into())
    }),
    number(
        record::REFERENCE_FORCE_N,
        "N",
        "Reference force F_c of Eq 7",
        |row| Cell::Number(row.output.reference_force_n.into()),
    ),
    text(record::MODE, "The controller's mode", |row| {
        Cell::Text(row.output.mode.name().into())
    }),
    text(
        record::FAULT,
        "The latched fault, empty if none",
        |row| match row.output.fault {
            None => Cell::Missing,
            Some(fault) => Cell::Text(fault.name().into()),
        },
    ),
    number(
        record::BRIDGE_COUNT,
        "ADC counts",
        "Strain-gauge bridge as the controller read it",
        |row| Cell::Number(row.sensors.bridge.0.into()),
    ),
    number(
        record::PRESSURE_COUNT,
        "ADC counts",
        "Pressure sensor as the controller read it",
        |row| Cell::Number(row.sensors.pressure.0.into()),
    ),
    number(
        record::ENCODER_COUNT,
        "counts",
        "Encoder as the controller read it",
        |row| Cell::Number(row.sensors.encoder.0.into()),
    ),
    number(
        record::READ_BACK_COUNT,
        "ADC counts",
        "The valve's voltage as the controller read it back, before this row's output",
        |row| Cell::Number(row.sensors.read_back.0.into()),
    ),
    number(
        record::MISSED_TICKS,
        "ticks",
        "Ticks that were missed before this one",
        |row| Cell::Number(row.sensors.missed_ticks.into()),
    ),
    text(record::REQUEST, "The request to the controller", |row| {
        Cell::Text(row.sensors.request.to_string())
    }),
    number(
        record::VALVE_COUNT,
        "DAC counts",
        "Valve output of the controller",
        |row| Cell::Number(row.output.valve.get().into()),
    ),
    number(
        record::EXACT_PRESSURE_REF_PA,
        "Pa",
        "Reference pressure before rounding to DAC counts (gauge)",
        |row| Cell::Number(row.output.pressure_ref.0.into()),
    ),
    number(
        record::TICK,
        "ticks",
        "The board's tick, counted since its reset",
        |row| maybe(row.board.map(|(tick, ..)| tick.into())),
    ),
    text(
        record::SOURCE,
        "Source of the sensor values: Pins, Link or Silence",
        |row| match row.board {
            None => Cell::Missing,
            Some((_, Source::Pins, _)) => Cell::Text("Pins".into()),
            Some((_, Source::Link(_), _)) => Cell::Text("Link".into()),
            Some((_, Source::Silence, _)) => Cell::Text("Silence".into()),
        },
    ),
    number(
        record::LATE_CYCLES,
        "CPU cycles",
        "Delay of the tick's start",
        |row| maybe(row.board.map(|(.., timing)| timing.late_cycles.into())),
    ),
    number(
        record::BUSY_CYCLES,
        "CPU cycles",
        "Duration of the previous tick",
        |row| maybe(row.board.map(|(.., timing)| timing.busy_cycles.into())),
    ),
    number(
        record::LINK_PER_MILLE,
        "1/1000",
        "Load of the serial link in the last whole second, in its busier direction",
        |row| maybe(row.board.map(|(.., timing)| timing.link_per_mille.into())),
    ),
    text(
        record::SETTINGS,
        "At a restart of the controller: its settings as stored, in hexadecimal digits",
        |row| {
            row.start_settings
                .as_ref()
                .map_or(Cell::Missing, |settings| Cell::Text(hex(settings)))
        },
    ),
    text(
        record::SOFTWARE,
        "In the first row: the version of hil-sim and, with a board, of its firmware",
        |row| {
            row.software
                .map_or(Cell::Missing, |software| Cell::Text(software.to_string()))
        },
    ),
];

/// The record of `rows`, without columns that have no value in any row.
///
/// # Panics
/// If there are no rows, or their times do not rise.
pub fn record(rows: &[Row]) -> Record {
    let mut record = Record::new(rows.iter().map(|row| row.time_s).collect());
    for column in &COLUMNS[1..] {
        let name = column.name;
        let cells: Vec<Cell> = rows.iter().map(column.value).collect();
        if cells.iter().all(|cell| *cell == Cell::Missing) && name != record::FAULT {
            continue;
        }
        if column.unit.is_none() {
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
