//! Records of a controller's ticks: what a row holds, and how rows are streamed to disk.

use crate::bench::closed_loop::{self, TICK_S};
use crate::output::NotWritten;
use crate::record::mcap::McapWriter;
use crate::record::{self, Record};
use model_core::io::{Output, Sensors};
use model_core::link::{Source, Telemetry};
use model_core::settings::{ENCODED_LEN_MAX, Settings};
use model_core::timing::Timing;
use std::fmt::Write as _;
use std::fs::File;
use std::io::Write as _;
use std::path::{Path, PathBuf};

/// Rows of a block: what is lost when the program is killed.
const BLOCK_ROWS: usize = 50;

/// One tick of a controller.
#[derive(Clone, Copy, Debug)]
pub struct Row {
    /// Time of sampling \[s\].
    pub time_s: f64,
    /// What the valve was asked for, rounded to DAC counts \[Pa\].
    pub pressure_ref_pa: f64,
    /// While an experiment is played: whether the cock between valve and muscle is to be shut.
    pub shut: Option<bool>,
    /// What the controller read.
    pub sensors: Sensors,
    /// What it decided.
    pub output: Output,
    /// With a simulated plant: muscle force \[N\] and finger displacement \[m\].
    pub plant: Option<(f64, f64)>,
    /// With a board: its tick, where the sensors came from, and its timing.
    pub board: Option<(u32, Source, Timing)>,
    /// The controller has begun anew before this tick, with these settings.
    pub begins_with: Option<Settings>,
}

/// One value of a row.
#[derive(Clone, Debug, PartialEq)]
pub enum Cell {
    /// There is none.
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

/// `settings` as they are stored, in hexadecimal digits.
fn hex(settings: &Settings) -> String {
    let mut buffer = [0; ENCODED_LEN_MAX];
    let mut digits = String::new();
    // The buffer holds any settings.
    for byte in settings.encode(&mut buffer).unwrap_or_default() {
        let _ = write!(digits, "{byte:02x}");
    }
    digits
}

/// What a record holds of each tick, in its order.
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
        row.begins_with
            .as_ref()
            .map_or(Cell::Missing, |settings| Cell::Text(hex(settings)))
    }),
];

/// The record of `rows`; columns that are empty throughout are left out.
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

/// Streams rows to a CSV file and an MCAP file beside it, block by block.
///
/// Each block is one write to each file: a program that is killed leaves readable files, and loses
/// the last block.
pub struct Recorder {
    csv_path: PathBuf,
    csv: File,
    block: csv::Writer<Vec<u8>>,
    rows: usize,
    mcap: McapWriter,
}

impl Recorder {
    /// Begins the files `path` and, with the ending `.mcap`, another one beside it.
    ///
    /// # Errors
    /// They cannot be written.
    pub fn create(path: &Path) -> Result<Recorder, NotWritten> {
        let csv = File::create(path).map_err(|source| NotWritten::new(path, source))?;
        let mut block = csv::Writer::from_writer(Vec::new());
        // Writing to memory cannot fail.
        let _ = block.write_record(COLUMNS.iter().map(|(name, ..)| name));
        let mut recorder = Recorder {
            csv_path: path.into(),
            csv,
            block,
            rows: 0,
            mcap: McapWriter::create(&path.with_extension("mcap"))?,
        };
        recorder.flush()?;
        Ok(recorder)
    }

    /// Adds a row.
    ///
    /// # Errors
    /// The files cannot be written.
    pub fn push(&mut self, row: &Row) -> Result<(), NotWritten> {
        let cells = COLUMNS.map(|(_, _, value)| value(row));
        let words = cells.iter().map(|cell| match cell {
            Cell::Number(number) if number.is_finite() => number.to_string(),
            Cell::Missing | Cell::Number(_) => String::new(),
            Cell::Text(word) => word.clone(),
        });
        let _ = self.block.write_record(words);
        self.mcap.push(row.time_s, &cells)?;
        self.rows += 1;
        if self.rows.is_multiple_of(BLOCK_ROWS) {
            self.flush()?;
        }
        Ok(())
    }

    /// Writes what is there.
    ///
    /// # Errors
    /// The files cannot be written.
    pub fn flush(&mut self) -> Result<(), NotWritten> {
        let empty = csv::Writer::from_writer(Vec::new());
        let block = std::mem::replace(&mut self.block, empty);
        let bytes = block.into_inner().unwrap_or_default();
        self.csv
            .write_all(&bytes)
            .map_err(|source| NotWritten::new(&self.csv_path, source))?;
        self.mcap.flush()
    }

    /// Ends both files; returns how many rows they have.
    ///
    /// # Errors
    /// The files cannot be written.
    pub fn finish(mut self) -> Result<usize, NotWritten> {
        self.flush()?;
        self.mcap.finish()?;
        Ok(self.rows)
    }
}

/// Makes rows of a board's telemetry.
pub struct Timeline {
    settings: Settings,
    last: Option<Telemetry>,
    time_s: f64,
}

impl Timeline {
    /// A timeline of a board with these settings, whose last telemetry, if known, was `last`.
    pub fn new(settings: Settings, last: Option<Telemetry>) -> Timeline {
        Timeline {
            settings,
            last,
            time_s: 0.0,
        }
    }

    /// The board has other settings from its next start on.
    pub fn set_settings(&mut self, settings: Settings) {
        self.settings = settings;
    }

    /// The row of a tick whose telemetry came `elapsed_s` after the beginning; none if the
    /// controller stood still. The board's clock counts, but for resets, whose length it does not
    /// know.
    pub fn row(&mut self, told: &Telemetry, elapsed_s: f64) -> Option<Row> {
        let last = self.last.replace(*told);
        let ahead = last.map_or(0, |last| told.tick.wrapping_sub(last.tick) as i32);
        let steps = f64::from(ahead) + f64::from(told.timing.missed_ticks);
        if ahead > 0 {
            self.time_s += TICK_S * steps;
        } else if last.is_some() {
            self.time_s = elapsed_s.max(self.time_s + TICK_S);
        }
        if told.source == Source::Silence {
            return None;
        }
        let changed = |last: Telemetry| is_link(last.source) != is_link(told.source);
        let begins = told.tick == 1 || (ahead == 1 && last.is_some_and(changed));
        let reference = closed_loop::valve_reference(&self.settings, &told.output);
        Some(Row {
            time_s: self.time_s,
            pressure_ref_pa: reference.0,
            shut: None,
            sensors: told.sensors,
            output: told.output,
            plant: None,
            board: Some((told.tick, told.source, told.timing)),
            begins_with: begins.then_some(self.settings),
        })
    }
}

/// Hardware in the loop: entering and leaving it begins the controller anew.
fn is_link(source: Source) -> bool {
    source != Source::Pins
}
