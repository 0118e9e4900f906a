//! Import of other programs' files as records: CSV with other names and units, xlsx, MATLAB, HDF5,
//! and MCAP.
//!
//! A mapping file ([`Map::EXAMPLE_TOML`]) assigns columns and units. [`Summary`] reports every
//! change, with its place.

#[cfg(feature = "formats")]
mod formats;
#[cfg(not(feature = "formats"))]
#[path = "no_formats.rs"]
mod formats;
mod source;
mod times;
mod variable;

use crate::error::{BadInput, one_of};
use crate::input::read_text;
use crate::record::units::{LENGTH, RATIO, TARGETS, TIME, Unit};
use crate::record::{Record, TIME_S, in_range};
use serde::{Deserialize, Serialize};
use serde_spanned::Spanned;
use source::Source;
use std::borrow::Cow;
use std::collections::BTreeMap;
use std::path::Path;
pub use times::Mended;

/// Whether crates read a file of these bytes, whose memory and time only a process of its own can
/// bound.
#[cfg(feature = "formats")]
pub fn is_read_by_crates(bytes: &[u8]) -> bool {
    formats::is_read_by_crates(bytes)
}

/// The mapping of a file's columns to those of a record.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Map {
    #[serde(skip)]
    place: Place,
    #[serde(default)]
    file: Layout,
    time: Spanned<TimeMap>,
    columns: BTreeMap<Spanned<String>, Column>,
}

/// Name and text of the mapping file, for error messages.
#[derive(Clone, Debug, Default)]
struct Place {
    file: String,
    text: String,
}

/// Layout of a CSV file or a sheet; not used for other formats.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields, default)]
struct Layout {
    sheet: Option<String>,
    delimiter: Spanned<char>,
    decimal_comma: bool,
    skip_lines: usize,
    header: bool,
    skip_after_header: usize,
    missing: Vec<String>,
}

impl Default for Layout {
    fn default() -> Layout {
        Layout {
            sheet: None,
            delimiter: Spanned::new(0..0, ','),
            decimal_comma: false,
            skip_lines: 0,
            header: true,
            skip_after_header: 0,
            missing: Vec::new(),
        }
    }
}

impl Layout {
    /// The layout of a CSV file of which only the `bytes` are known: the delimiter is the one that
    /// its first line has most of, and a comma between two digits is a decimal one if it is not
    /// the delimiter and no point is.
    fn of_text(bytes: &[u8]) -> Layout {
        let line = bytes.split(|byte| *byte == b'\n').next().unwrap_or(bytes);
        let count = |delimiter: &char| {
            line.iter()
                .filter(|byte| **byte == *delimiter as u8)
                .count()
        };
        // Of equal counts, as none, the last counts.
        let delimiter = ['\t', ';', ','].into_iter().max_by_key(count);
        let delimiter = delimiter.unwrap_or(',');
        let between_digits = |byte: u8| {
            let is = |three: &[u8]| {
                three[1] == byte && three[0].is_ascii_digit() && three[2].is_ascii_digit()
            };
            bytes.windows(3).any(is)
        };
        Layout {
            delimiter: Spanned::new(0..0, delimiter),
            decimal_comma: delimiter != ',' && between_digits(b',') && !between_digits(b'.'),
            ..Layout::default()
        }
    }
}

/// Source of the time: a column or a sampling rate.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct TimeMap {
    column: Option<Selector>,
    unit: Option<Spanned<String>>,
    rate_hz: Option<f64>,
    #[serde(default)]
    repeated: Repeated,
    #[serde(default)]
    restarted: Restarted,
}

/// A column of the file, by its name or by its number from 1.
#[derive(Clone, Debug, Deserialize)]
#[serde(untagged, expecting = "a column's name, or its number from 1")]
enum Selector {
    Number(usize),
    Name(String),
}

/// Treatment of rows with the time of the previous row.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "kebab-case")]
enum Repeated {
    /// Bad input.
    #[default]
    Refuse,
    /// Only the first row is kept.
    Drop,
    /// The times were rounded: they are spread evenly up to the next time.
    Spread,
}

/// Treatment of rows with an earlier time than the previous row.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "kebab-case")]
enum Restarted {
    /// Bad input.
    #[default]
    Refuse,
    /// Rows are left out until the time exceeds that of the last row kept.
    Drop,
    /// The clock was reset: the time continues a median period after the previous row.
    Continue,
}

/// Source of a column: (cell · scale + offset) in `unit`.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct Column {
    column: Selector,
    unit: Spanned<String>,
    #[serde(default = "one")]
    scale: f64,
    #[serde(default)]
    offset: f64,
}

/// Characters of an error that lists a file's names.
const NAMES_LEN: usize = 120;

fn one() -> f64 {
    1.0
}

/// Report of an import.
#[derive(Clone, Debug, Serialize)]
pub struct Summary {
    /// `CSV`, `xlsx`, `MATLAB 5`, `MATLAB 7.3` or `MCAP`.
    pub format: &'static str,
    /// What there is to say about the file: its sheet, where it is damaged.
    pub notes: Vec<String>,
    /// Encoding of the text, if not UTF-8.
    pub encoding: Option<&'static str>,
    /// Number of rows of the file.
    pub rows_read: usize,
    /// Number of rows of the record.
    pub rows_written: usize,
    /// Rows with the time of the previous row.
    pub repeated_times: Mended,
    /// Rows with an earlier time than the previous row.
    pub restarted_times: Mended,
    /// Source of the time, in words.
    pub time: String,
    /// The record's columns.
    pub columns: Vec<ColumnSummary>,
    /// Columns of the file that are not in the record.
    pub left_out: Vec<String>,
}

/// Report on one column.
#[derive(Clone, Debug, Serialize)]
pub struct ColumnSummary {
    /// Name in the record.
    pub name: &'static str,
    /// Name or number in the file.
    pub source: String,
    /// Conversion from the file's numbers to the record's.
    pub conversion: String,
    /// Number of cells without a sample.
    pub missing: usize,
    /// The smallest sample, in the record's unit.
    pub min: f64,
    /// The largest sample.
    pub max: f64,
}

/// An imported record with its report.
#[derive(Clone, Debug)]
pub struct Imported {
    /// The record.
    pub record: Record,
    /// Report of the import.
    pub summary: Summary,
}

impl Map {
    /// A commented mapping for [`Map::EXAMPLE_CSV`].
    pub const EXAMPLE_TOML: &'static str = include_str!("example.toml");
    /// The file to which [`Map::EXAMPLE_TOML`] applies.
    pub const EXAMPLE_CSV: &'static str = include_str!("example.csv");

    /// Reads the mapping at `path`.
    ///
    /// # Errors
    /// The file cannot be read, or is not a mapping: see [`Map::parse`].
    pub fn read(path: &Path) -> Result<Map, BadInput> {
        let name = path.display().to_string();
        Map::parse(&name, &read_text(path, "a readable TOML file")?)
    }

    /// Reads a mapping from the text of the file `name`.
    ///
    /// # Errors
    /// The text is not a mapping, with line: an unknown key, column or unit, a wrong type.
    pub fn parse(name: &str, text: &str) -> Result<Map, BadInput> {
        let place = Place {
            file: name.into(),
            text: text.into(),
        };
        let mut map: Map = toml_edit::de::from_str(text).map_err(|error| {
            let why = error.message().replace('\n', " ");
            place.bad(
                error.span().unwrap_or(0..0),
                None,
                &format!("a mapping, {why}"),
            )
        })?;
        map.place = place;
        map.check()?;
        Ok(map)
    }

    /// The mapping of a file that has a record's names, in which some columns are in other units:
    /// `units` are `COLUMN=UNIT[,scale=S][,offset=O]`. Delimiter and decimal commas are found in
    /// the `bytes`. Times that a rounded clock repeats are spread.
    ///
    /// # Errors
    /// The file cannot be read, has other names, lacks a column of `units`, or one of them has no
    /// such form or unit.
    pub fn of_record(file: &str, bytes: &[u8], units: &[String]) -> Result<Map, BadInput> {
        let bad = |expected: String| BadInput::file("--unit", expected);
        let layout = Layout::of_text(bytes);
        let names = Source::open(file, bytes.into(), &layout, &[])?.left_out(&[]);
        let known = [(TIME_S, TIME)].into_iter().chain(TARGETS);
        let known: Vec<_> = known
            .filter(|(name, _)| names.iter().any(|found| found == name))
            .collect();
        if !known.iter().any(|(name, _)| *name == TIME_S) || known.len() < 2 {
            let mut names = names.join(", ");
            if let Some((end, _)) = names.char_indices().nth(NAMES_LEN) {
                names.replace_range(end.., "…");
            }
            let expected = format!(
                "`{TIME_S}` and another column of a record, found {names}; a mapping (`hil-sim \
                 import --example`) has other names, delimiters and decimal commas"
            );
            return Err(BadInput::file(file, expected));
        }
        let mut keys: BTreeMap<&str, String> = BTreeMap::new();
        for option in units {
            let (name, rest) = option.split_once('=').unwrap_or((option, ""));
            let found = known.iter().find(|(known, _)| *known == name);
            let (name, _) = found.ok_or_else(|| {
                let names: Vec<_> = known.iter().map(|(name, _)| *name).collect();
                bad(format!("COLUMN=UNIT with {}", one_of(&names, name)))
            })?;
            let mut parts = rest.split(',');
            let mut lines = format!("unit = {:?}\n", parts.next().unwrap_or_default());
            for part in parts {
                let number = part.split_once('=').filter(|(key, value)| {
                    ["scale", "offset"].contains(key) && value.parse::<f64>().is_ok()
                });
                let (key, value) = number
                    .ok_or_else(|| bad(format!("scale=NUMBER or offset=NUMBER, found `{part}`")))?;
                let value: f64 = value.parse().unwrap_or_default();
                lines += &format!("{key} = {value:?}\n");
            }
            keys.insert(*name, lines);
        }
        let sections = known.iter().map(|(name, units)| {
            let section = match *name {
                TIME_S => "time".into(),
                name => format!("columns.{name}"),
            };
            let unit = || format!("unit = {:?}\n", units[0].0);
            let mut lines = keys.remove(name).unwrap_or_else(unit);
            if *name == TIME_S {
                lines += "repeated = \"spread\"\n";
            }
            format!("[{section}]\ncolumn = {name:?}\n{lines}")
        });
        let text: String = sections.collect();
        let map = Map::parse("--unit", &text).map_err(|error| BadInput {
            line: None,
            ..error
        });
        Ok(Map {
            file: layout,
            ..map?
        })
    }

    fn check(&self) -> Result<(), BadInput> {
        let bad = |span, key: &str, expected: &str| Err(self.place.bad(span, Some(key), expected));
        let Layout {
            delimiter,
            decimal_comma,
            ..
        } = &self.file;
        let byte = *delimiter.get_ref();
        if !byte.is_ascii() || byte.is_ascii_alphanumeric() || "\"\r\n.+-".contains(byte) {
            let expected = format!("one ASCII character that is in no number, found {byte:?}");
            return bad(delimiter.span(), "file.delimiter", &expected);
        }
        if *decimal_comma && byte == ',' {
            let expected = "another delimiter than `,`, as decimal_comma is true";
            return bad(delimiter.span(), "file.delimiter", expected);
        }
        let time = self.time.get_ref();
        match (&time.column, time.rate_hz) {
            (Some(_), None) => {
                unit_of(
                    &self.place,
                    "time",
                    time.unit.as_ref(),
                    TIME,
                    &self.time.span(),
                )?;
            }
            (None, Some(rate_hz)) if rate_hz > 0.0 && rate_hz.is_finite() => {}
            (None, Some(rate_hz)) => {
                let expected = format!("a rate above 0, found {rate_hz}");
                return bad(self.time.span(), "time.rate_hz", &expected);
            }
            _ => return bad(self.time.span(), "time", "either `column` or `rate_hz`"),
        }
        for (target, column) in &self.columns {
            let (key, span) = (target.get_ref(), target.span());
            let Some((_, units)) = TARGETS.iter().find(|(name, _)| name == key) else {
                let known = TARGETS.map(|(name, _)| name).join(", ");
                return bad(span, &format!("columns.{key}"), &format!("one of {known}"));
            };
            let key = format!("columns.{key}");
            unit_of(&self.place, &key, Some(&column.unit), units, &span)?;
            if !column.scale.is_finite() || column.scale == 0.0 || !column.offset.is_finite() {
                return bad(
                    span,
                    &key,
                    "a scale other than 0 and an offset, both finite",
                );
            }
        }
        if self.columns.is_empty() {
            return bad(0..0, "columns", "at least one column, found none");
        }
        Ok(())
    }

    /// Imports the `bytes` of the file `name`, which are freed early if they are given away.
    ///
    /// # Errors
    /// The file does not fit the mapping, with line and column.
    pub fn import<'a>(
        &'a self,
        name: &str,
        bytes: impl Into<Cow<'a, [u8]>>,
    ) -> Result<Imported, BadInput> {
        let selectors = self.columns.values().map(|column| &column.column);
        let used: Vec<_> = selectors.chain(&self.time.get_ref().column).collect();
        let mut source = Source::open(name, bytes.into(), &self.file, &used)?;
        let times = self.times(&mut source)?;
        let mut summary = Summary {
            format: source.format(),
            notes: source.notes().to_vec(),
            encoding: source.encoding(),
            rows_read: times.rows_read,
            rows_written: times.rows_read - times.dropped.len(),
            repeated_times: times.repeated.clone(),
            restarted_times: times.restarted.clone(),
            time: times.source.clone(),
            columns: Vec::new(),
            left_out: source.left_out(&used),
        };
        let mut converted = Vec::new();
        for (target, units) in TARGETS {
            let mut columns = self.columns.iter();
            let Some((_, column)) = columns.find(|(key, _)| key.get_ref() == target) else {
                continue;
            };
            let key = format!("columns.{target}");
            let unit = unit_of(&self.place, &key, Some(&column.unit), units, &(0..0))?;
            let (values, column) =
                column.convert(&mut source, target, unit, (times.rows_read, &times.dropped))?;
            converted.push((target, values));
            summary.columns.push(column);
        }
        // Of a long file there is memory for its bytes or for its times.
        drop(source);
        let mut record = Record::new(times.time_s());
        for (target, values) in converted {
            record.set(target, values);
        }
        record.check_times_and_reference(name)?;
        Ok(Imported { record, summary })
    }
}

impl Column {
    /// The samples in SI units, but of the `dropped` rows; the file has `rows_read` rows.
    fn convert(
        &self,
        source: &mut Source,
        target: &'static str,
        unit: &Unit,
        (rows_read, dropped): (usize, &[u32]),
    ) -> Result<(Vec<f64>, ColumnSummary), BadInput> {
        let (name, mut values) = source.column(&self.column)?;
        if values.len() != rows_read {
            let expected = format!(
                "{rows_read} rows as in other columns, found {}",
                values.len()
            );
            return Err(source.bad_column(&name, &expected));
        }
        let (unit, factor, zero) = unit;
        let (mut min, mut max) = (f64::INFINITY, f64::NEG_INFINITY);
        let mut dropped = dropped.iter().map(|row| *row as usize).peekable();
        // In place, as a file may have millions of rows.
        let mut kept = 0;
        for row in 0..rows_read {
            if dropped.next_if_eq(&row).is_some() {
                continue;
            }
            let value = (values[row] * self.scale + self.offset) * factor + zero;
            if !value.is_nan() {
                in_range(target, value)
                    .map_err(|why| source.bad(row, &name, &format!("what is {target} as {why}")))?;
                (min, max) = (min.min(value), max.max(value));
            }
            values[kept] = value;
            kept += 1;
        }
        values.truncate(kept);
        let missing = values.iter().filter(|value| value.is_nan()).count();
        if missing == values.len() {
            let expected = format!("at least one sample of {target}, found none");
            return Err(source.bad_column(&name, &expected));
        }
        let mut conversion = match self.scale {
            1.0 => "cell".into(),
            scale => format!("{scale} × cell"),
        };
        if self.offset != 0.0 {
            conversion += &format!(" {:+}", self.offset);
        }
        conversion += &format!(", in {unit}");
        if (*factor, *zero) != (1.0, 0.0) {
            conversion += &format!(", × {factor}");
        }
        if *zero != 0.0 {
            conversion += &format!(" {zero:+}");
        }
        let summary = ColumnSummary {
            name: target,
            source: name,
            conversion,
            missing,
            min,
            max,
        };
        Ok((values, summary))
    }
}

fn unit_of<'a>(
    place: &Place,
    key: &str,
    name: Option<&Spanned<String>>,
    units: &'a [Unit],
    section: &std::ops::Range<usize>,
) -> Result<&'a Unit, BadInput> {
    let known = || {
        let names: Vec<_> = units.iter().map(|(name, ..)| *name).collect();
        names.join(", ")
    };
    let key = format!("{key}.unit");
    let Some(name) = name else {
        let expected = format!("one of {}, found no such key", known());
        return Err(place.bad(section.clone(), Some(&key), &expected));
    };
    let unit = units.iter().find(|(unit, ..)| unit == name.get_ref());
    unit.ok_or_else(|| {
        let mut expected = format!("one of {}, found `{}`", known(), name.get_ref());
        if units == RATIO && LENGTH.iter().any(|(unit, ..)| unit == name.get_ref()) {
            expected +=
                ": for a length write unit = \"1\" and scale = 1/(the muscle's length in it)";
        }
        place.bad(name.span(), Some(&key), &expected)
    })
}

impl Place {
    fn bad(&self, span: std::ops::Range<usize>, key: Option<&str>, expected: &str) -> BadInput {
        let before = self.text.as_bytes().iter().take(span.start);
        BadInput {
            line: Some(1 + before.filter(|byte| **byte == b'\n').count()),
            place: key.map(|key| format!("key `{key}`")),
            ..BadInput::file(&self.file, expected)
        }
    }
}

impl std::fmt::Display for Selector {
    fn fmt(&self, f: &mut std::fmt::Formatter) -> std::fmt::Result {
        match self {
            Selector::Number(number) => write!(f, "column {number}"),
            Selector::Name(name) => write!(f, "column `{name}`"),
        }
    }
}
