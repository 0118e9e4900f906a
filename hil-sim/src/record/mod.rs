//! Records: one run of one rig, as samples over time.
//!
//! Known columns are numbers in SI units, NaN where a sample is missing; an unknown column is kept
//! as text ([`Record::check_names`] refuses misspelled ones). The file format is CSV: a header
//! line, then one row per sample.

pub mod check;
pub mod columns;
mod csv;
pub mod import;
pub mod mcap;
mod misnamed;
pub(crate) mod units;

use crate::error::BadInput;
pub use csv::csv_of_columns;
pub(crate) use csv::{newlines, row_start};

/// Time of the sample \[s\].
pub const TIME_S: &str = "time_s";
/// Reference pressure sent to the valve (gauge) \[Pa\], held until the next row.
pub const PRESSURE_REF_PA: &str = "pressure_ref_pa";
/// Measured muscle pressure (gauge) \[Pa\].
pub const PRESSURE_PA: &str = "pressure_pa";
/// Measured contraction \[-\].
pub const CONTRACTION: &str = "contraction";
/// Measured muscle force \[N\].
pub const FORCE_N: &str = "force_n";
/// Finger displacement \[m\].
pub const FINGER_M: &str = "finger_m";
/// Finger force \[N\].
pub const INPUT_FORCE_N: &str = "input_force_n";
/// Measured supply pressure (gauge) \[Pa\].
pub const SUPPLY_PA: &str = "supply_pa";
/// Measured gas temperature \[K\].
pub const TEMPERATURE_K: &str = "temperature_k";
/// 1 if the valve is connected to the muscle, 0 if a shut-off valve between the valve and the
/// pressure sensor is closed or is requested to be; held until the next row; 1 if the column is
/// absent.
pub const VALVE_OPEN: &str = "valve_open";

/// The board's tick, counted since its reset.
pub const TICK: &str = "tick";
/// Strain-gauge bridge as the controller read it \[ADC counts\].
pub const BRIDGE_COUNT: &str = "bridge_count";
/// Pressure sensor as the controller read it \[ADC counts\].
pub const PRESSURE_COUNT: &str = "pressure_count";
/// Encoder as the controller read it \[counts\].
pub const ENCODER_COUNT: &str = "encoder_count";
/// The valve's voltage as the controller read it back \[ADC counts\].
pub const READ_BACK_COUNT: &str = "read_back_count";
/// Ticks that were missed before this one.
pub const MISSED_TICKS: &str = "missed_ticks";
/// The request to the controller: text, see `model_core::io::Request`.
pub const REQUEST: &str = "request";
/// Valve output of the controller \[DAC counts\].
pub const VALVE_COUNT: &str = "valve_count";
/// P_r before rounding to DAC counts \[Pa\].
pub const EXACT_PRESSURE_REF_PA: &str = "exact_pressure_ref_pa";
/// F_c of Eq 7 \[N\].
pub const REFERENCE_FORCE_N: &str = "reference_force_n";
/// The controller's mode: text.
pub const MODE: &str = "mode";
/// The latched fault: text, empty if none.
pub const FAULT: &str = "fault";
/// Source of the sensor values: text, `Pins` or `Link`.
pub const SOURCE: &str = "source";
/// Delay of the tick's start \[CPU cycles\].
pub const LATE_CYCLES: &str = "late_cycles";
/// Duration of the previous tick \[CPU cycles\].
pub const BUSY_CYCLES: &str = "busy_cycles";
/// Load of the board's serial link \[1/1000\].
pub const LINK_PER_MILLE: &str = "link_per_mille";
/// Empty except in the tick in which the controller restarts: its settings as stored in flash, in
/// hexadecimal digits.
pub const SETTINGS: &str = "settings";
/// Version of the programs that made the record.
pub const SOFTWARE: &str = "software";

/// The known columns and the range of values that they can have on any rig of this kind. Numbers in
/// other units of the trade, such as contractions in mm, are within: [`check`] names the unit.
const KNOWN: [(&str, f64, f64); 22] = [
    (TIME_S, -1e12, 1e12),
    (PRESSURE_REF_PA, -1e8, 1e8),
    (PRESSURE_PA, -1e8, 1e8),
    (CONTRACTION, -1e4, 1e4),
    (FORCE_N, -1e6, 1e6),
    (FINGER_M, -100.0, 100.0),
    (INPUT_FORCE_N, -1e6, 1e6),
    (SUPPLY_PA, -1e8, 1e8),
    (TEMPERATURE_K, 1.0, 1e4),
    (VALVE_OPEN, 0.0, 1.0),
    (TICK, 0.0, U32_MAX),
    (BRIDGE_COUNT, 0.0, 65_535.0),
    (PRESSURE_COUNT, 0.0, 65_535.0),
    (ENCODER_COUNT, 0.0, U32_MAX),
    (READ_BACK_COUNT, 0.0, 65_535.0),
    (MISSED_TICKS, 0.0, 255.0),
    (VALVE_COUNT, 0.0, 4_095.0),
    (EXACT_PRESSURE_REF_PA, -1e8, 1e8),
    (REFERENCE_FORCE_N, -1e6, 1e6),
    (LATE_CYCLES, 0.0, U32_MAX),
    (BUSY_CYCLES, 0.0, U32_MAX),
    (LINK_PER_MILLE, 0.0, 65_535.0),
];

const U32_MAX: f64 = u32::MAX as f64;
/// The cells of one column.
#[derive(Clone, Debug, PartialEq)]
enum Cells {
    /// A known quantity; NaN where a sample is missing.
    Numbers(Vec<f64>),
    /// Anything else.
    Text(Vec<String>),
}

/// One run of one rig.
#[derive(Clone, Debug)]
pub struct Record {
    file: String,
    /// The line of each row; empty for a record that was not read from a file.
    lines: Vec<u32>,
    time_s: Vec<f64>,
    /// Rows that had the time of the row before.
    repeated: Vec<usize>,
    /// All columns in the file's order; `None` is the time.
    columns: Vec<Option<(String, Cells)>>,
}

impl Record {
    /// A record that has times alone.
    ///
    /// # Panics
    /// If `time_s` is empty or does not rise.
    pub fn new(time_s: Vec<f64>) -> Record {
        assert!(!time_s.is_empty() && time_s.windows(2).all(|pair| pair[0] < pair[1]));
        Record {
            file: "record".into(),
            lines: Vec::new(),
            time_s,
            repeated: Vec::new(),
            columns: vec![None],
        }
    }

    /// Name of the file that it was read from.
    pub fn file(&self) -> &str {
        &self.file
    }

    /// Times of the samples \[s\], rising. Of two rows with the same time in the file, the second
    /// is halfway to the next row.
    pub fn time_s(&self) -> &[f64] {
        &self.time_s
    }

    /// Number of the rows that had the time of the row before in the file, and the line of the
    /// first; `None` if there is none.
    pub fn repeated_times(&self) -> Option<(usize, usize)> {
        let first = self.repeated.first()?;
        Some((self.repeated.len(), self.line(*first)?))
    }

    /// A known column's samples, NaN where one is missing; `None` if the record lacks the column or
    /// the column has no sample.
    pub fn column(&self, name: &str) -> Option<&[f64]> {
        let values = self.cells(name)?;
        let present = values.iter().any(|value| !value.is_nan());
        present.then_some(values)
    }

    /// For each row, whether a shut-off valve between valve and muscle is closed (see
    /// [`VALVE_OPEN`]); empty if it never is.
    pub fn shut(&self) -> Vec<bool> {
        let mut shut = false;
        let open = self.column(VALVE_OPEN).unwrap_or_default().iter();
        let rows: Vec<bool> = open
            .map(|open| {
                if !open.is_nan() {
                    shut = *open == 0.0;
                }
                shut
            })
            .collect();
        if rows.contains(&true) {
            rows
        } else {
            Vec::new()
        }
    }

    /// Whether the record has this known column without a sample in it.
    pub fn is_empty_column(&self, name: &str) -> bool {
        self.cells(name).is_some() && self.column(name).is_none()
    }

    /// A known column's cells, also if none has a sample.
    fn cells(&self, name: &str) -> Option<&[f64]> {
        match self.find(name)? {
            Cells::Numbers(values) => Some(values),
            Cells::Text(_) => None,
        }
    }

    fn find(&self, name: &str) -> Option<&Cells> {
        let mut columns = self.columns.iter().flatten();
        columns.find_map(|(known, cells)| (known == name).then_some(cells))
    }

    /// As [`Record::column`].
    ///
    /// # Errors
    /// The record lacks the column, or the column has no sample.
    pub fn require(&self, name: &str) -> Result<&[f64], BadInput> {
        self.column(name).ok_or_else(|| match self.cells(name) {
            None => self.bad(name, "this column, found none"),
            Some(_) => self.bad(name, "at least one sample, found none"),
        })
    }

    /// The columns of numbers in the file's order, the time among them.
    pub fn numbers(&self) -> impl Iterator<Item = (&str, &[f64])> {
        self.columns.iter().filter_map(|column| match column {
            None => Some((TIME_S, &self.time_s[..])),
            Some((name, Cells::Numbers(values))) => Some((name, values)),
            Some((_, Cells::Text(_))) => None,
        })
    }

    /// Names of the columns that nothing reads.
    pub fn left_out(&self) -> Vec<&str> {
        let columns = self.columns.iter().flatten();
        let unknown = columns.filter(|(_, cells)| matches!(cells, Cells::Text(_)));
        let names = unknown.map(|(name, _)| name.as_str());
        let is_of_ticks = |name: &&str| columns::COLUMNS.iter().any(|known| known.name == *name);
        names.filter(|name| !is_of_ticks(name)).collect()
    }

    /// An unknown column's cells; `None` if the record lacks the column.
    pub fn text(&self, name: &str) -> Option<&[String]> {
        match self.find(name)? {
            Cells::Text(words) => Some(words),
            Cells::Numbers(_) => None,
        }
    }

    /// As [`Record::text`].
    ///
    /// # Errors
    /// The record lacks the column.
    pub fn require_text(&self, name: &str) -> Result<&[String], BadInput> {
        self.text(name)
            .ok_or_else(|| self.bad(name, "this column, found none"))
    }

    /// Bad input in a column as a whole.
    pub fn bad(&self, column: &str, expected: &str) -> BadInput {
        BadInput {
            place: Some(format!("column `{column}`")),
            ..BadInput::file(&self.file, expected)
        }
    }

    /// Bad input in a column's `row`.
    pub fn bad_cell(&self, column: &str, row: usize, expected: &str) -> BadInput {
        BadInput {
            line: self.line(row),
            ..self.bad(column, expected)
        }
    }

    /// Removes a column, if the record has it.
    pub fn remove(&mut self, name: &str) {
        let other = |column: &Option<(String, Cells)>| {
            column.as_ref().is_none_or(|(known, _)| known != name)
        };
        self.columns.retain(other);
    }

    /// Bad input in the record as a whole.
    pub fn bad_file(&self, expected: &str) -> BadInput {
        BadInput::file(&self.file, expected)
    }

    /// Bad input at `time_s` of the record.
    pub fn bad_at(&self, time_s: f64, expected: &str) -> BadInput {
        let row = self.time_s.partition_point(|row_s| *row_s <= time_s);
        BadInput {
            line: self.line(row.saturating_sub(1)),
            ..BadInput::file(&self.file, expected)
        }
    }

    /// The line of the file on which a row begins.
    fn line(&self, row: usize) -> Option<usize> {
        self.lines.get(row).map(|line| *line as usize)
    }

    /// Replaces the column of that name by numbers, or appends the column.
    ///
    /// # Panics
    /// If the number of values is not that of the rows.
    pub fn set(&mut self, name: &str, values: Vec<f64>) {
        assert_eq!(values.len(), self.time_s.len());
        self.put(name, Cells::Numbers(values));
    }

    /// As [`Record::set`], for text.
    ///
    /// # Panics
    /// As [`Record::set`].
    pub fn set_text(&mut self, name: &str, values: Vec<String>) {
        assert_eq!(values.len(), self.time_s.len());
        self.put(name, Cells::Text(values));
    }

    fn put(&mut self, name: &str, cells: Cells) {
        let mut columns = self.columns.iter_mut().flatten();
        match columns.find(|(known, _)| known == name) {
            Some(column) => column.1 = cells,
            None => self.columns.push(Some((name.into(), cells))),
        }
    }
}

/// `value`, if it is in the range of its column.
///
/// # Errors
/// What was expected.
pub(crate) fn in_range(column: &str, value: f64) -> Result<f64, String> {
    if column == VALVE_OPEN && ![0.0, 1.0].contains(&value) {
        return Err(format!("1 (open) or 0 (shut), found {value}"));
    }
    let range = KNOWN.iter().find(|(known, ..)| *known == column);
    let (_, min, max) = range.unwrap_or(&("", f64::MIN, f64::MAX));
    if (*min..=*max).contains(&value) {
        Ok(value)
    } else {
        Err(format!("a number from {min} to {max}, found {value}"))
    }
}
