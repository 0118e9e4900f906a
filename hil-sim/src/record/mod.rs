//! Records: one run of one rig as CSV, a header line and then a row a sample.
//!
//! Columns that other programs rely on are named here; they are numbers in SI units, and an empty
//! cell is a missing sample. Unknown columns are kept as the text they are.

pub mod check;
pub mod columns;
pub mod import;
pub mod mcap;

use crate::error::BadInput;
use crate::output::{NotWritten, write_atomically};
use std::path::Path;

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
/// 1 where the valve is connected to the muscle, 0 where a cock between it and the pressure sensor
/// is shut, or is asked to be; held until the next row; connected if it is not said.
pub const VALVE_OPEN: &str = "valve_open";

/// The board's tick, counted since its reset.
pub const TICK: &str = "tick";
/// Strain-gauge bridge as the controller read it \[ADC counts\].
pub const BRIDGE_COUNT: &str = "bridge_count";
/// Pressure sensor as the controller read it \[ADC counts\].
pub const PRESSURE_COUNT: &str = "pressure_count";
/// Encoder as the controller read it \[counts\].
pub const ENCODER_COUNT: &str = "encoder_count";
/// Ticks that did not happen before this one.
pub const MISSED_TICKS: &str = "missed_ticks";
/// What was asked for: text, see `model_core::io::Request`.
pub const REQUEST: &str = "request";
/// What the controller sent to the valve \[DAC counts\].
pub const VALVE_COUNT: &str = "valve_count";
/// P_r before it was rounded to DAC counts \[Pa\].
pub const EXACT_PRESSURE_REF_PA: &str = "exact_pressure_ref_pa";
/// F_c of Eq 7 \[N\].
pub const REFERENCE_FORCE_N: &str = "reference_force_n";
/// The controller's mode: text.
pub const MODE: &str = "mode";
/// The latched fault: text, empty if none.
pub const FAULT: &str = "fault";
/// Where the sensors came from: text, `Pins` or `Link`.
pub const SOURCE: &str = "source";
/// How late the tick began \[CPU cycles\].
pub const LATE_CYCLES: &str = "late_cycles";
/// How long the tick before took \[CPU cycles\].
pub const BUSY_CYCLES: &str = "busy_cycles";
/// Not empty where the controller has begun anew: its settings as they are stored in flash, in
/// hexadecimal digits.
pub const SETTINGS: &str = "settings";

/// The known columns and the range that their values can have on any rig of this kind.
const KNOWN: [(&str, f64, f64); 20] = [
    (TIME_S, -1e12, 1e12),
    (PRESSURE_REF_PA, -1e8, 1e8),
    (PRESSURE_PA, -1e8, 1e8),
    (CONTRACTION, -1.0, 1.0),
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
    (MISSED_TICKS, 0.0, 255.0),
    (VALVE_COUNT, 0.0, 4_095.0),
    (EXACT_PRESSURE_REF_PA, -1e8, 1e8),
    (REFERENCE_FORCE_N, -1e6, 1e6),
    (LATE_CYCLES, 0.0, U32_MAX),
    (BUSY_CYCLES, 0.0, U32_MAX),
];

const U32_MAX: f64 = u32::MAX as f64;
/// The longest time between two rows, and from the first to the last \[s\]: what is beyond them is
/// milliseconds or microseconds, and takes hours.
const GAP_S_MAX: f64 = 1e4;
const LENGTH_S_MAX: f64 = 1e6;

/// At most one row in so many may have the time of the row before.
const REPEATED_ONE_IN: usize = 100;

fn not_after(before_s: f64, time_s: f64) -> String {
    format!(
        "a time after {before_s}, found {time_s} (`hil-sim import` mends clocks that repeat or \
         restart)"
    )
}

/// One column.
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
    /// The line of each row; empty for a record that was not read.
    lines: Vec<u32>,
    time_s: Vec<f64>,
    /// Every column but the time, in the file's order; `None` stands where the time was.
    columns: Vec<Option<(String, Cells)>>,
}

impl Record {
    /// A record with times and nothing else.
    ///
    /// # Panics
    /// If `time_s` is empty or does not rise: whoever makes a record has made its times.
    pub fn new(time_s: Vec<f64>) -> Record {
        assert!(!time_s.is_empty() && time_s.windows(2).all(|pair| pair[0] < pair[1]));
        Record {
            file: "record".into(),
            lines: Vec::new(),
            time_s,
            columns: vec![None],
        }
    }

    /// Reads the file at `path`.
    ///
    /// # Errors
    /// It cannot be read, or is not a record: see [`Record::parse`].
    pub fn read(path: &Path) -> Result<Record, BadInput> {
        let name = path.display().to_string();
        let bytes = std::fs::read(path)
            .map_err(|error| BadInput::file(&name, format!("a readable CSV file, {error}")))?;
        Record::parse(&name, &bytes)
    }

    /// Reads a record from the bytes of the file `name`.
    ///
    /// # Errors
    /// Anything that is not a record, with its line and column.
    pub fn parse(name: &str, bytes: &[u8]) -> Result<Record, BadInput> {
        let bytes = bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(bytes);
        let mut reader = csv::ReaderBuilder::new()
            .trim(csv::Trim::All)
            .from_reader(bytes);
        let header = match reader.headers() {
            Ok(header) => header.clone(),
            Err(error) => return Err(not_csv(name, bytes, &error)),
        };
        let columns = columns(name, &header)?;
        let mut record = Record {
            file: name.into(),
            lines: Vec::new(),
            time_s: Vec::new(),
            columns,
        };
        let mut row = csv::StringRecord::new();
        let (mut line, mut counted) = (1, 0);
        while reader
            .read_record(&mut row)
            .map_err(|error| not_csv(name, bytes, &error))?
        {
            let begin = content(bytes, row.position());
            line += newlines(&bytes[counted..begin]);
            counted = begin;
            record.push(line, &row)?;
        }
        // The reader takes all that follows an open quote for one cell.
        if ends_in_quotes(bytes) {
            return Err(BadInput {
                line: Some(line),
                ..BadInput::file(name, "a closing quote, found the end of the file")
            });
        }
        if record.time_s.is_empty() {
            return Err(BadInput {
                line: Some(2),
                ..BadInput::file(name, "at least one row of samples, found none")
            });
        }
        record.part_repeated_times()?;
        record.begins_with_a_reference()?;
        Ok(record)
    }

    /// A clock that is rounded gives two rows one time now and then: the second goes halfway to the
    /// next row.
    fn part_repeated_times(&mut self) -> Result<(), BadInput> {
        let repeats = |row: &usize| self.time_s[*row] == self.time_s[*row - 1];
        let repeated: Vec<usize> = (1..self.time_s.len()).filter(repeats).collect();
        let often = repeated.len() * REPEATED_ONE_IN > self.time_s.len();
        for row in repeated {
            let before_s = self.time_s[row - 1];
            match self.time_s.get(row + 1) {
                Some(next_s) if *next_s > before_s && !often => {
                    self.time_s[row] = 0.5 * (before_s + next_s);
                }
                _ => return Err(self.bad_cell(TIME_S, row, &not_after(before_s, before_s))),
            }
        }
        Ok(())
    }

    fn begins_with_a_reference(&self) -> Result<(), BadInput> {
        match self.column(PRESSURE_REF_PA) {
            Some([first, ..]) if first.is_nan() => {
                let expected = "a reference in the first row, as it is held, found none";
                Err(self.bad_cell(PRESSURE_REF_PA, 0, expected))
            }
            _ => Ok(()),
        }
    }

    /// Adds a row that stands on `line`.
    fn push(&mut self, line: usize, row: &csv::StringRecord) -> Result<(), BadInput> {
        let first_s = self.time_s.first().copied();
        let bad = |column: &str, expected: String| BadInput {
            file: self.file.clone(),
            line: Some(line),
            place: Some(format!("column `{column}`")),
            expected,
        };
        for (column, cell) in self.columns.iter_mut().zip(row) {
            match column {
                None => {
                    let time_s = number(TIME_S, cell).map_err(|why| bad(TIME_S, why))?;
                    let before_s = self.time_s.last().copied().unwrap_or(f64::NEG_INFINITY);
                    if time_s.is_nan() {
                        return Err(bad(TIME_S, "a time in every row, found none".into()));
                    }
                    if time_s < before_s {
                        return Err(bad(TIME_S, not_after(before_s, time_s)));
                    }
                    if first_s.is_some() && time_s - before_s > GAP_S_MAX {
                        let why = format!(
                            "seconds, at most {GAP_S_MAX} from row to row, found {before_s} and \
                             then {time_s}"
                        );
                        return Err(bad(TIME_S, why));
                    }
                    if first_s.is_some_and(|first_s| time_s - first_s > LENGTH_S_MAX) {
                        let why = format!("seconds, at most {LENGTH_S_MAX} in all, found more");
                        return Err(bad(TIME_S, why));
                    }
                    self.time_s.push(time_s);
                }
                Some((name, Cells::Numbers(values))) => {
                    values.push(number(name, cell).map_err(|why| bad(name, why))?);
                }
                Some((_, Cells::Text(values))) => values.push(cell.into()),
            }
        }
        self.lines.push(line as u32);
        Ok(())
    }

    /// Times of the samples \[s\], rising; of two rows with one time, the second halfway on.
    pub fn time_s(&self) -> &[f64] {
        &self.time_s
    }

    /// A known column's samples, NaN where one is missing; `None` if the record lacks it or it has
    /// none.
    pub fn column(&self, name: &str) -> Option<&[f64]> {
        let values = self.cells(name)?;
        let present = values.iter().any(|value| !value.is_nan());
        present.then_some(values)
    }

    /// Of each row: whether a cock between valve and muscle is shut (see [`VALVE_OPEN`]); empty if
    /// it never is.
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

    /// The record has this known column, and no sample in it.
    pub fn is_empty_column(&self, name: &str) -> bool {
        self.cells(name).is_some() && self.column(name).is_none()
    }

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
    /// The record lacks it.
    pub fn require(&self, name: &str) -> Result<&[f64], BadInput> {
        self.column(name).ok_or_else(|| match self.cells(name) {
            None => self.bad(name, "this column, found none"),
            Some(_) => self.bad(name, "at least one sample, found none"),
        })
    }

    /// An unknown column's words; `None` if the record lacks it.
    pub fn text(&self, name: &str) -> Option<&[String]> {
        match self.find(name)? {
            Cells::Text(words) => Some(words),
            Cells::Numbers(_) => None,
        }
    }

    /// As [`Record::text`].
    ///
    /// # Errors
    /// The record lacks it.
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

    /// Takes a column out, if there is such a one.
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

    /// Puts a column of numbers in the place of the one of that name, or at the end.
    ///
    /// # Panics
    /// If there is not one value a row.
    pub fn set(&mut self, name: &str, values: Vec<f64>) {
        assert_eq!(values.len(), self.time_s.len());
        self.place(name, Cells::Numbers(values));
    }

    /// As [`Record::set`], of words.
    ///
    /// # Panics
    /// If there is not one word a row.
    pub fn set_text(&mut self, name: &str, values: Vec<String>) {
        assert_eq!(values.len(), self.time_s.len());
        self.place(name, Cells::Text(values));
    }

    fn place(&mut self, name: &str, cells: Cells) {
        let mut columns = self.columns.iter_mut().flatten();
        match columns.find(|(known, _)| known == name) {
            Some(column) => column.1 = cells,
            None => self.columns.push(Some((name.into(), cells))),
        }
    }

    /// The record as CSV: the shortest decimals that read back as the same numbers.
    pub fn to_csv(&self) -> Vec<u8> {
        let mut writer = csv::Writer::from_writer(Vec::new());
        let names = self.columns.iter().map(|column| match column {
            None => TIME_S,
            Some((name, _)) => name,
        });
        let mut text = String::new();
        let mut rows = csv::StringRecord::from_iter(names);
        // Writing to memory cannot fail.
        let _ = writer.write_record(&rows);
        for (row, time_s) in self.time_s.iter().enumerate() {
            rows.clear();
            for column in &self.columns {
                text.clear();
                match column {
                    None => text.push_str(&time_s.to_string()),
                    Some((_, Cells::Numbers(values))) if values[row].is_nan() => {}
                    Some((_, Cells::Numbers(values))) => text.push_str(&values[row].to_string()),
                    Some((_, Cells::Text(values))) => text.push_str(&values[row]),
                }
                rows.push_field(&text);
            }
            let _ = writer.write_record(&rows);
        }
        writer.into_inner().unwrap_or_default()
    }

    /// Writes the record to `path`, whole or not at all.
    ///
    /// # Errors
    /// The file cannot be written.
    pub fn write(&self, path: &Path) -> Result<(), NotWritten> {
        write_atomically(path, &self.to_csv())
    }
}

/// The columns of a header, empty.
fn columns(
    file: &str,
    header: &csv::StringRecord,
) -> Result<Vec<Option<(String, Cells)>>, BadInput> {
    let bad = |expected: String| BadInput {
        line: Some(1),
        ..BadInput::file(file, expected)
    };
    let mut columns: Vec<Option<(String, Cells)>> = Vec::new();
    for (place, name) in header.iter().enumerate() {
        if name.is_empty() {
            return Err(bad(format!("a name for column {}, found none", place + 1)));
        }
        if header.iter().take(place).any(|before| before == name) {
            return Err(bad(format!("each column once, found `{name}` again")));
        }
        columns.push(match name {
            TIME_S => None,
            _ if KNOWN.iter().any(|(known, ..)| *known == name) => {
                Some((name.into(), Cells::Numbers(Vec::new())))
            }
            _ => Some((name.into(), Cells::Text(Vec::new()))),
        });
    }
    if columns.iter().all(Option::is_some) {
        return Err(bad(
            "a header line with a column `time_s`, found none".into()
        ));
    }
    Ok(columns)
}

/// A cell of a known column: a number in its range, or NaN for an empty one.
fn number(column: &str, cell: &str) -> Result<f64, String> {
    if cell.is_empty() {
        return Ok(f64::NAN);
    }
    match cell.parse::<f64>() {
        Ok(value) if value.is_finite() => in_range(column, value),
        _ => Err(format!("a number or an empty cell, found `{cell}`")),
    }
}

/// The value of a known column, if it can have it on any rig of this kind.
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

/// Where a row begins, from where the reader began to look for it: blank lines are no rows.
pub(crate) fn content(bytes: &[u8], position: Option<&csv::Position>) -> usize {
    let from = position.map_or(0, |position| position.byte() as usize);
    let rest = bytes.get(from..).unwrap_or_default();
    let blank = rest.iter().take_while(|byte| matches!(byte, b'\r' | b'\n'));
    from.min(bytes.len()) + blank.count()
}

pub(crate) fn newlines(bytes: &[u8]) -> usize {
    bytes.iter().filter(|byte| **byte == b'\n').count()
}

/// A quote that opens a cell is never closed. A quote within a cell is a character like others.
fn ends_in_quotes(bytes: &[u8]) -> bool {
    let (mut open, mut may_open) = (false, true);
    for byte in bytes {
        if open {
            // After the quote that closes another one would be the second of a pair.
            open = *byte != b'"';
            may_open = !open;
        } else {
            open = may_open && *byte == b'"';
            may_open = matches!(byte, b',' | b'\r' | b'\n');
        }
    }
    open
}

/// What the CSV reader did not like.
fn not_csv(file: &str, bytes: &[u8], error: &csv::Error) -> BadInput {
    let line = error
        .position()
        .map(|position| 1 + newlines(&bytes[..content(bytes, Some(position))]));
    let expected = match error.kind() {
        csv::ErrorKind::UnequalLengths {
            expected_len, len, ..
        } => {
            format!("{expected_len} cells as in the header, found {len}")
        }
        csv::ErrorKind::Utf8 { .. } => "text in UTF-8, found other bytes".into(),
        _ => format!("CSV, {error}"),
    };
    BadInput {
        line: Some(line.unwrap_or(1)),
        ..BadInput::file(file, expected)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn reads_what_it_wrote() {
        let text = "note,contraction,time_s,pressure_pa\n\"a, b\",0.1,0,\n,,0.01,1e5\n";
        let record = Record::parse("x.csv", text.as_bytes()).expect("a record");
        assert_eq!(record.time_s(), [0.0, 0.01]);
        let contraction = record.column(CONTRACTION).expect("the column");
        assert!(contraction[0] == 0.1 && contraction[1].is_nan());
        assert!(record.column("note").is_none());
        let written = String::from_utf8(record.to_csv()).expect("text");
        assert_eq!(
            written,
            "note,contraction,time_s,pressure_pa\n\"a, b\",0.1,0,\n,,0.01,100000\n"
        );
    }

    #[test]
    fn tolerates_a_byte_order_mark_and_other_line_ends() {
        let record = Record::parse("x.csv", b"\xef\xbb\xbftime_s , contraction\r\n 0 , 0.1\r\n");
        assert_eq!(
            record.expect("a record").column(CONTRACTION),
            Some(&[0.1][..])
        );
    }
}
