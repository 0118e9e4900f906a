//! Records as CSV: reading with the line of each row, and writing.

use super::misnamed::misnamed_time;
use super::{Cells, KNOWN, PRESSURE_REF_PA, Record, TIME_S, in_range};
use crate::error::BadInput;
use crate::input;
use crate::output::{NotWritten, write_atomically_with};
use std::collections::HashSet;
use std::io::Write;
use std::path::Path;

/// The longest time between two rows, and from the first to the last \[s\]. Longer times are most
/// likely in milliseconds or microseconds, and would take hours to simulate.
const GAP_S_MAX: f64 = 1e4;
const LENGTH_S_MAX: f64 = 1e6;

/// At most one row in this many may repeat the time of the row before: a clock of 1 ms does at
/// 550 Hz, once in thousands.
const REPEATED_ONE_IN: usize = 1000;

/// Characters of a header that an error repeats.
const HEADER_LEN: usize = 60;

/// What is expected of a file that ends within quotes.
const NO_QUOTE: &str = "a closing quote, found the end of the file";

/// The way around a row of units.
const UNITS: &str =
    " (`hil-sim import` leaves out a row of units, with `skip_after_header = 1` in its mapping)";

/// What is expected of a time that is not after `before_s`.
fn not_after(before_s: f64, time_s: f64) -> String {
    format!(
        "a time after {before_s}, found {time_s} (`hil-sim import` corrects clocks that repeat or \
         restart)"
    )
}

impl Record {
    /// Reads the file at `path`.
    ///
    /// # Errors
    /// The file cannot be read, or is not a record: see [`Record::parse`].
    pub fn read(path: &Path) -> Result<Record, BadInput> {
        Record::parse(&path.display().to_string(), &Record::read_bytes(path)?)
    }

    /// The bytes of the file at `path`, for [`Record::parse`].
    ///
    /// # Errors
    /// The file cannot be read.
    pub fn read_bytes(path: &Path) -> Result<Vec<u8>, BadInput> {
        input::read(path, "a readable CSV file")
    }

    /// Reads a record from the bytes of the file `name`.
    ///
    /// # Errors
    /// The bytes are not a record, with line and column.
    pub fn parse(name: &str, bytes: &[u8]) -> Result<Record, BadInput> {
        let bytes = bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(bytes);
        let mut reader = csv::ReaderBuilder::new()
            // Cells below are trimmed where they are read: here it takes an allocation a row.
            .trim(csv::Trim::Headers)
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
            repeated: Vec::new(),
            columns,
        };
        let mut row = csv::StringRecord::new();
        let (mut line, mut counted) = (1, 0);
        while reader
            .read_record(&mut row)
            .map_err(|error| not_csv(name, bytes, &error))?
        {
            let begin = row_start(bytes, row.position());
            line += newlines(&bytes[counted..begin]);
            counted = begin;
            record.push(line, &row)?;
        }
        if ends_in_quotes(bytes) {
            return Err(BadInput {
                line: Some(line),
                ..BadInput::file(name, NO_QUOTE)
            });
        }
        if record.time_s.is_empty() {
            return Err(BadInput {
                line: Some(2),
                ..BadInput::file(name, "at least one row of samples, found none")
            });
        }
        record.spread_repeated_times()?;
        record.check_first_reference()?;
        Ok(record)
    }

    /// Moves the second of two rows with equal times, as a rounded clock gives them occasionally,
    /// halfway to the next row.
    fn spread_repeated_times(&mut self) -> Result<(), BadInput> {
        let is_repeated = |row: &usize| self.time_s[*row] == self.time_s[*row - 1];
        let repeated: Vec<usize> = (1..self.time_s.len()).filter(is_repeated).collect();
        let often = repeated.len() * REPEATED_ONE_IN > self.time_s.len();
        for row in &repeated {
            let (row, before_s) = (*row, self.time_s[row - 1]);
            match self.time_s.get(row + 1) {
                Some(next_s) if *next_s > before_s && !often => {
                    self.time_s[row] = 0.5 * (before_s + next_s);
                }
                _ => return Err(self.bad_cell(TIME_S, row, &not_after(before_s, before_s))),
            }
        }
        self.repeated = repeated;
        Ok(())
    }

    /// Makes the checks of [`Record::parse`] that concern several rows, of a record with rising
    /// times that was imported from `file`.
    pub(super) fn check_times_and_reference(&mut self, file: &str) -> Result<(), BadInput> {
        self.file = file.into();
        let first_s = self.time_s[0];
        for pair in self.time_s.windows(2) {
            within_limits(first_s, pair[0], pair[1]).map_err(|why| self.bad(TIME_S, &why))?;
        }
        self.check_first_reference()
    }

    /// Refuses a reference without a value in the first row.
    fn check_first_reference(&self) -> Result<(), BadInput> {
        match self.column(PRESSURE_REF_PA) {
            Some([first, ..]) if first.is_nan() => {
                let expected = "a reference in the first row, as it is held, found none";
                Err(self.bad_cell(PRESSURE_REF_PA, 0, expected))
            }
            _ => Ok(()),
        }
    }

    /// Adds the row on `line`.
    fn push(&mut self, line: usize, row: &csv::StringRecord) -> Result<(), BadInput> {
        let first_s = self.time_s.first().copied();
        let bad = |column: &str, expected: String| BadInput {
            file: self.file.clone(),
            line: Some(line),
            place: Some(format!("column `{column}`")),
            expected,
        };
        for (column, cell) in self.columns.iter_mut().zip(row.iter().map(str::trim)) {
            match column {
                None => {
                    let time_s = number(TIME_S, cell).map_err(|mut why| {
                        // A unit, in any notation, as loggers write it below the name.
                        if first_s.is_none()
                            && cell.parse::<f64>().is_err()
                            && !cell.contains(|one: char| one.is_ascii_digit())
                        {
                            why.push_str(UNITS);
                        }
                        bad(TIME_S, why)
                    })?;
                    let before_s = self.time_s.last().copied().unwrap_or(f64::NEG_INFINITY);
                    if time_s.is_nan() {
                        return Err(bad(TIME_S, "a time in every row, found none".into()));
                    }
                    if time_s < before_s {
                        return Err(bad(TIME_S, not_after(before_s, time_s)));
                    }
                    if let Some(first_s) = first_s {
                        within_limits(first_s, before_s, time_s).map_err(|why| bad(TIME_S, why))?;
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

    /// The record as CSV: the shortest decimals that read back as the same numbers.
    pub fn to_csv(&self) -> Vec<u8> {
        let mut bytes = Vec::new();
        // Writing to memory cannot fail.
        let _ = self.write_csv(&mut bytes);
        bytes
    }

    fn write_csv(&self, out: impl Write) -> std::io::Result<()> {
        let mut writer = csv::Writer::from_writer(out);
        let names = self.columns.iter().map(|column| match column {
            None => TIME_S,
            Some((name, _)) => name,
        });
        writer.write_record(names)?;
        let mut text = Vec::new();
        for (row, time_s) in self.time_s.iter().enumerate() {
            for column in &self.columns {
                text.clear();
                match column {
                    None => push(&mut text, *time_s)?,
                    Some((_, Cells::Numbers(values))) if values[row].is_nan() => {}
                    Some((_, Cells::Numbers(values))) => push(&mut text, values[row])?,
                    Some((_, Cells::Text(values))) => text.extend(values[row].as_bytes()),
                }
                writer.write_field(&text)?;
            }
            writer.write_record(None::<&[u8]>)?;
        }
        writer.flush()
    }

    /// Writes the record to `path` atomically.
    ///
    /// # Errors
    /// The file cannot be written.
    pub fn write(&self, path: &Path) -> Result<(), NotWritten> {
        write_atomically_with(path, |out| self.write_csv(out))
    }
}

/// The bytes of a record's file with `columns`, in which NaN is a missing sample.
///
/// # Errors
/// There is none, or they differ in length.
pub fn csv_of_columns<'a>(
    name: &str,
    columns: impl Iterator<Item = (&'a str, Vec<f64>)>,
) -> Result<Vec<u8>, BadInput> {
    let (names, columns): (Vec<&str>, Vec<Vec<f64>>) = columns.unzip();
    let bad = |expected: String| BadInput::file(name, expected);
    let rows = columns.first().map(Vec::len);
    let rows = rows.ok_or_else(|| bad(format!("a column `{TIME_S}` and another, found none")))?;
    let other = columns
        .iter()
        .zip(&names)
        .find(|(own, _)| own.len() != rows);
    if let Some((own, column)) = other {
        let (first, found) = (names[0], own.len());
        return Err(bad(format!(
            "columns of equal length, found {rows} in `{first}` and {found} in `{column}`"
        )));
    }
    let mut writer = csv::Writer::from_writer(Vec::new());
    let mut text = Vec::new();
    let mut write = || -> csv::Result<()> {
        writer.write_record(&names)?;
        for row in 0..rows {
            for column in &columns {
                text.clear();
                if !column[row].is_nan() {
                    push(&mut text, column[row])?;
                }
                writer.write_field(&text)?;
            }
            writer.write_record(None::<&[u8]>)?;
        }
        Ok(())
    };
    write().map_err(|error| bad(error.to_string()))?;
    writer.into_inner().map_err(|error| bad(error.to_string()))
}

/// Appends the shortest decimal that reads back as `value`.
fn push(text: &mut Vec<u8>, value: f64) -> std::io::Result<()> {
    // Whole numbers have the same digits as integers, which are written several times faster.
    let whole = value as i64;
    if whole as f64 == value && whole != 0 && whole.unsigned_abs() < 1 << 53 {
        write!(text, "{whole}")
    } else {
        write!(text, "{value}")
    }
}

/// Refuses a time too long after the row before or the first one.
fn within_limits(first_s: f64, before_s: f64, time_s: f64) -> Result<(), String> {
    if time_s - before_s > GAP_S_MAX {
        return Err(format!(
            "seconds, at most {GAP_S_MAX} from row to row, found {before_s} and then {time_s} (in \
             ms or us? `hil-sim import --unit time_s=ms` converts them)"
        ));
    }
    if time_s - first_s > LENGTH_S_MAX {
        return Err(format!(
            "seconds, at most {LENGTH_S_MAX} in all, found more (in ms or us? `hil-sim import \
             --unit time_s=ms` converts them)"
        ));
    }
    Ok(())
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
    let mut names = HashSet::new();
    for (place, name) in header.iter().enumerate() {
        if name.is_empty() {
            return Err(bad(format!("a name for column {}, found none", place + 1)));
        }
        if !names.insert(name) {
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
        let none = || {
            let found: String = header.iter().collect::<Vec<_>>().join(",");
            let found: String = found.chars().take(HEADER_LEN).collect();
            let found = match found.as_str() {
                "" => "an empty file".into(),
                _ => format!("`{found}` (`hil-sim import` reads other names and delimiters)"),
            };
            bad(format!(
                "a header line with a column `time_s`, found {found}"
            ))
        };
        return Err(misnamed_time(file, header.iter()).unwrap_or_else(none));
    }
    Ok(columns)
}

/// The value of a known column's cell: a number in its range, or NaN if the cell is empty.
///
/// # Errors
/// What was expected.
fn number(column: &str, cell: &str) -> Result<f64, String> {
    if cell.is_empty() {
        return Ok(f64::NAN);
    }
    match cell.parse::<f64>() {
        Ok(value) if value.is_finite() => in_range(column, value),
        Ok(value) if value.is_nan() => Err(format!(
            "a number or an empty cell, found `{cell}` (`hil-sim import` takes it as empty)"
        )),
        _ => Err(format!("a number or an empty cell, found `{cell}`")),
    }
}

/// The offset at which a row begins: after the blank lines at the reader's `position`.
pub(crate) fn row_start(bytes: &[u8], position: Option<&csv::Position>) -> usize {
    let from = position.map_or(0, |position| position.byte() as usize);
    let rest = bytes.get(from..).unwrap_or_default();
    let blank = rest.iter().take_while(|byte| matches!(byte, b'\r' | b'\n'));
    from.min(bytes.len()) + blank.count()
}

/// Number of line feeds in `bytes`.
pub(crate) fn newlines(bytes: &[u8]) -> usize {
    bytes.iter().filter(|byte| **byte == b'\n').count()
}

/// Whether a quote that opens a cell is never closed. A quote within a cell has no meaning.
fn ends_in_quotes(bytes: &[u8]) -> bool {
    let (mut open, mut may_open) = (false, true);
    for byte in bytes {
        if open {
            // A quote directly after the closing one is the second of an escaped pair.
            open = *byte != b'"';
            may_open = !open;
        } else {
            open = may_open && *byte == b'"';
            may_open = matches!(byte, b',' | b'\r' | b'\n');
        }
    }
    open
}

/// The error of the CSV reader as bad input.
fn not_csv(file: &str, bytes: &[u8], error: &csv::Error) -> BadInput {
    let line = error
        .position()
        .map(|position| 1 + newlines(&bytes[..row_start(bytes, Some(position))]));
    let expected = match error.kind() {
        // The CSV reader takes everything after an unclosed quote as one cell.
        csv::ErrorKind::UnequalLengths { .. } if ends_in_quotes(bytes) => NO_QUOTE.into(),
        csv::ErrorKind::UnequalLengths {
            expected_len, len, ..
        } => {
            format!("{expected_len} cells as in the header, found {len}")
        }
        csv::ErrorKind::Utf8 { .. } => {
            "text in UTF-8, found other bytes (`hil-sim import` reads Latin-1, xlsx, MATLAB, HDF5 \
             and MCAP, and says what converts other formats)"
                .into()
        }
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
    use crate::record::CONTRACTION;

    #[test]
    fn a_record_reads_back_as_it_was_written() {
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
    fn a_byte_order_mark_and_carriage_returns_are_ignored() {
        let record = Record::parse("x.csv", b"\xef\xbb\xbftime_s , contraction\r\n 0 , 0.1\r\n");
        assert_eq!(
            record.expect("a record").column(CONTRACTION),
            Some(&[0.1][..])
        );
    }
}
