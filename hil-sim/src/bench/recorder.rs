//! Streams a controller's ticks to disk as CSV and MCAP, and makes rows of a board's telemetry.

use crate::bench::instruments::valve_reference;
use crate::bench::tick::TICK_S;
use crate::output::{NotWritten, write_atomically};
use crate::record::columns::{COLUMNS, Cell, Row, Software};
use crate::record::mcap::{self, McapWriter, Origin};
use model_core::link::{Source, Telemetry};
use model_core::settings::Settings;
use std::fs::File;
use std::io::Write as _;
use std::path::{Path, PathBuf};

/// Rows of a block. A program that is killed loses at most one block.
const BLOCK_ROWS: usize = 50;

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
    /// For the first row.
    software: Option<Software>,
}

impl Recorder {
    /// Creates the files `path` and beside it, with the extension `.mcap`, another one, which says
    /// where the record comes from, and with `.layout.json` the panels with which viewers show it.
    ///
    /// # Errors
    /// A file cannot be written.
    pub fn create(path: &Path, origin: &Origin) -> Result<Recorder, NotWritten> {
        let csv = File::create(path).map_err(|source| NotWritten::new(path, source))?;
        let mut block = csv::Writer::from_writer(Vec::new());
        // Writing to memory cannot fail.
        let _ = block.write_record(COLUMNS.iter().map(|column| column.name));
        let mut recorder = Recorder {
            csv_path: path.into(),
            csv,
            block,
            rows: 0,
            mcap: McapWriter::create(&path.with_extension("mcap"), origin)?,
            software: Some(origin.software),
        };
        recorder.flush()?;
        let layout = format!("{:#}\n", mcap::layout());
        write_atomically(&path.with_extension("layout.json"), layout.as_bytes())?;
        Ok(recorder)
    }

    /// Adds a row; the first one states the software.
    ///
    /// # Errors
    /// The files cannot be written.
    pub fn push(&mut self, row: &Row) -> Result<(), NotWritten> {
        let row = Row {
            software: self.software.take(),
            ..*row
        };
        let cells = COLUMNS.map(|column| (column.value)(&row));
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

    /// Writes the rows that are not yet on disk.
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

    /// Completes both files; returns their number of rows.
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

    /// Sets the settings that the board has from its next start on.
    pub fn set_settings(&mut self, settings: Settings) {
        self.settings = settings;
    }

    /// The row of a tick whose telemetry came `elapsed_s` after the start of the recording; none if
    /// the controller did not tick. Times are the board's, except across a reset, whose duration
    /// the board does not know.
    pub fn row(&mut self, telemetry: &Telemetry, elapsed_s: f64) -> Option<Row> {
        let last = self.last.replace(*telemetry);
        let ahead = last.map_or(0, |last| telemetry.tick.wrapping_sub(last.tick) as i32);
        let steps = f64::from(ahead) + f64::from(telemetry.timing.missed_ticks);
        if ahead > 0 {
            self.time_s += TICK_S * steps;
        } else if last.is_some() {
            self.time_s = elapsed_s.max(self.time_s + TICK_S);
        }
        if telemetry.source == Source::Silence {
            return None;
        }
        let changed = |last: Telemetry| is_link(last.source) != is_link(telemetry.source);
        let starts = telemetry.tick == 1 || (ahead == 1 && last.is_some_and(changed));
        let reference = valve_reference(&self.settings, &telemetry.output);
        Some(Row {
            time_s: self.time_s,
            pressure_ref_pa: reference.0,
            shut: None,
            sensors: telemetry.sensors,
            output: telemetry.output,
            plant: None,
            board: Some((telemetry.tick, telemetry.source, telemetry.timing)),
            start_settings: starts.then_some(self.settings),
            software: None,
        })
    }
}

/// True with hardware in the loop. Entering and leaving it restarts the controller.
fn is_link(source: Source) -> bool {
    source != Source::Pins
}
