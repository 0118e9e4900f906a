//! Reading of the files that can be imported, as columns of numbers.

use super::variable::{Content, Variable};
use super::{BadInput, Layout, Selector, formats};
use crate::error::did_you_mean;
use crate::record::{newlines, row_start};
use std::borrow::Cow;

/// The columns of one file.
pub(super) struct Source<'a> {
    file: String,
    format: &'static str,
    notes: Vec<String>,
    kind: Kind<'a>,
}

enum Kind<'a> {
    Csv(Csv<'a>),
    Variables(Variables),
}

/// The variables of a file that has more than columns.
struct Variables {
    variables: Vec<Variable>,
    /// How many numbers may be read, and may still be.
    numbers_max: usize,
    numbers_left: usize,
}

/// A CSV file or a sheet, and the numbers of the columns that are used: a cell's text needs ten
/// times the memory of its number.
struct Csv<'a> {
    layout: &'a Layout,
    kind: Text,
    text: Cow<'a, str>,
    names: Vec<String>,
    columns: Vec<Numbers>,
}

/// Where the text is from.
#[derive(Clone, Copy, PartialEq)]
enum Text {
    /// A file in UTF-8.
    Csv,
    /// A file in Latin-1.
    Latin1,
    /// A sheet of a workbook.
    Sheet,
}

/// The numbers of one column up to the first cell that is none, with its row and what was expected.
struct Numbers {
    index: usize,
    values: Vec<f64>,
    bad: Option<(usize, String)>,
    /// How many selectors will still ask for them.
    uses: usize,
}

/// With which some programs begin a text in UTF-8.
const BYTE_ORDER_MARK: char = '\u{feff}';

/// How files of other programs begin, and the command that converts them.
const OTHER_FORMATS: [(&[u8], &str); 8] = [
    (
        b"PK\x03\x04",
        "a spreadsheet's CSV (`libreoffice --headless --convert-to csv FILE`), found a ZIP file as \
         ods is",
    ),
    (
        b"\xd0\xcf\x11\xe0",
        "a spreadsheet's CSV (`libreoffice --headless --convert-to csv FILE`), found an old Office \
         file as xls is",
    ),
    (
        b"PAR1",
        "CSV (`duckdb -c \"COPY 'FILE' TO 'out.csv' (HEADER)\"`), found Parquet",
    ),
    (
        b"ULog\x01\x12\x35",
        "CSV (`ulog2csv FILE` of pyulog), found ULog",
    ),
    (
        b"MDF     ",
        "CSV (`python3 -c \"import asammdf; asammdf.MDF('FILE').export('csv')\"`), found MDF",
    ),
    (
        b"SQLite format 3",
        "CSV (`sqlite3 -header -csv FILE 'select * from TABLE'`) or MCAP (`rosbags-convert --src \
         FOLDER --dst out --dst-storage mcap` of rosbags), found SQLite, as older bags of ROS 2 \
         are",
    ),
    (b"%PDF", "a table as CSV, found a PDF"),
    (b"\x1f\x8b", "an unpacked file (`gunzip FILE`), found gzip"),
];

impl<'a> Source<'a> {
    /// Reads the `bytes` of the file `name`, of which `used` columns are needed; their first bytes
    /// tell the format.
    ///
    /// # Errors
    /// The bytes are not of the format, with line.
    pub fn open(
        name: &str,
        bytes: Cow<'a, [u8]>,
        layout: &'a Layout,
        used: &[&Selector],
    ) -> Result<Source<'a>, BadInput> {
        let (kind, format, notes) = match formats::read(name, &bytes, layout, used)? {
            Some(Content::Variables {
                variables,
                format,
                notes,
            }) => {
                let numbers_max = formats::numbers_max(bytes.len());
                let variables = Variables {
                    variables,
                    numbers_max,
                    numbers_left: numbers_max,
                };
                (Kind::Variables(variables), format, notes)
            }
            Some(Content::Text {
                text,
                format,
                notes,
            }) => {
                let csv = Csv::read(name, Cow::Owned(text), Text::Sheet, layout, used)?;
                (Kind::Csv(csv), format, notes)
            }
            None => (
                Kind::Csv(Csv::open(name, bytes, layout, used)?),
                "CSV",
                Vec::new(),
            ),
        };
        Ok(Source {
            file: name.into(),
            format,
            notes,
            kind,
        })
    }

    pub fn format(&self) -> &'static str {
        self.format
    }

    /// What there is to say about the file.
    pub fn notes(&self) -> &[String] {
        &self.notes
    }

    pub fn encoding(&self) -> Option<&'static str> {
        matches!(
            &self.kind,
            Kind::Csv(Csv {
                kind: Text::Latin1,
                ..
            })
        )
        .then_some("Latin-1")
    }

    /// The position of a row: its line in a CSV file or a sheet, else its number from 1.
    pub fn place(&self, row: usize) -> usize {
        match &self.kind {
            Kind::Csv(csv) => csv.line(row),
            Kind::Variables(_) => row + 1,
        }
    }

    /// Bad input in a row of the column `name`.
    pub fn bad(&self, row: usize, name: &str, expected: &str) -> BadInput {
        let place = self.place(row);
        match self.kind {
            Kind::Csv(_) => BadInput {
                line: Some(place),
                ..self.bad_column(name, expected)
            },
            Kind::Variables(_) => self.bad_column(&format!("{name}, row {place}"), expected),
        }
    }

    /// Bad input in the column `name`.
    pub fn bad_column(&self, name: &str, expected: &str) -> BadInput {
        BadInput {
            place: Some(name.into()),
            ..BadInput::file(&self.file, expected)
        }
    }

    /// A column's name in messages and its numbers, one per row, NaN where one is missing. Of the
    /// columns for which [`Source::open`] was called, each may be asked for once.
    ///
    /// # Errors
    /// The file lacks the column, the column has no row, or a cell is not a finite number.
    pub fn column(&mut self, selector: &Selector) -> Result<(String, Vec<f64>), BadInput> {
        let name = selector.to_string();
        let read = match &mut self.kind {
            Kind::Csv(csv) => csv.take(selector),
            Kind::Variables(variables) => variables.read(selector).map_err(|why| (None, why)),
        };
        let values = read.map_err(|(row, why)| match row {
            Some(row) => self.bad(row, &name, &why),
            None => self.bad_column(&name, &why),
        })?;
        if values.is_empty() {
            return Err(self.bad_column(&name, "at least one row of samples, found none"));
        }
        if let Some(row) = values.iter().position(|value| value.is_infinite()) {
            return Err(self.bad(row, &name, "a finite number, found an infinite one"));
        }
        Ok((name, values))
    }

    /// The number of rows of a column; 0 if the file lacks it.
    pub fn rows(&self, selector: &Selector) -> usize {
        match &self.kind {
            Kind::Csv(csv) => {
                let column = csv.find(selector).and_then(|index| {
                    let mut columns = csv.columns.iter();
                    columns.find(|column| column.index == index)
                });
                column.map_or(0, |column| column.values.len())
            }
            Kind::Variables(variables) => match variables.find(selector) {
                Some((index, None)) => {
                    let variable = &variables.variables[index];
                    variable.height.saturating_mul(variable.width)
                }
                Some((index, Some(_))) => variables.variables[index].height,
                None => 0,
            },
        }
    }

    /// The names of the columns that are not among `used`.
    pub fn left_out(&self, used: &[&Selector]) -> Vec<String> {
        match &self.kind {
            Kind::Csv(csv) => {
                let used: Vec<_> = used.iter().filter_map(|used| csv.find(used)).collect();
                let names = csv.names.iter().enumerate();
                let rest = names.filter(|(index, _)| !used.contains(index));
                rest.map(|(_, name)| name.clone()).collect()
            }
            Kind::Variables(variables) => {
                let used = used.iter().filter_map(|used| variables.find(used));
                let used: Vec<_> = used.map(|(index, _)| index).collect();
                let rest = variables.variables.iter().enumerate();
                let rest = rest.filter(|(index, _)| !used.contains(index));
                rest.map(|(_, variable)| variable.words()).collect()
            }
        }
    }
}

impl<'a> Csv<'a> {
    fn open(
        name: &str,
        bytes: Cow<'a, [u8]>,
        layout: &'a Layout,
        used: &[&Selector],
    ) -> Result<Csv<'a>, BadInput> {
        if bytes.starts_with(b"\xff\xfe") || bytes.starts_with(b"\xfe\xff") {
            let expected = format!(
                "text in UTF-8 or Latin-1, found UTF-16 (`iconv -f UTF-16 -t UTF-8 {name}` \
                 converts it)"
            );
            return Err(BadInput::file(name, expected));
        }
        let other = OTHER_FORMATS
            .iter()
            .find(|(begin, _)| bytes.starts_with(begin));
        if let Some((_, expected)) = other {
            return Err(BadInput::file(name, expected.replace("FILE", name)));
        }
        let first = bytes.trim_ascii_start();
        let is_page = [&b"<!DOCTYPE html"[..], b"<html"].into_iter().any(|begin| {
            let first = first.get(..begin.len());
            first.is_some_and(|first| first.eq_ignore_ascii_case(begin))
        });
        if is_page {
            let expected = "a table as CSV, found a web page, whose table a spreadsheet can save";
            return Err(BadInput::file(name, expected));
        }
        // In no text, and in nearly every picture, document and program.
        if bytes.contains(&0) {
            let expected = "text, or one of the formats of `hil-sim import --help`, found a \
                            byte of 0, as in a picture, a document or a program";
            return Err(BadInput::file(name, expected));
        }
        let utf_8 = match bytes {
            Cow::Borrowed(bytes) => std::str::from_utf8(bytes)
                .map(Cow::Borrowed)
                .map_err(|_| Cow::Borrowed(bytes)),
            Cow::Owned(bytes) => String::from_utf8(bytes)
                .map(Cow::Owned)
                .map_err(|error| Cow::Owned(error.into_bytes())),
        };
        let (text, kind) = match utf_8 {
            Ok(text) => (text, Text::Csv),
            Err(bytes) => {
                let bytes = bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(&bytes);
                // Latin-1 is the first 256 code points of Unicode.
                let text = bytes.iter().map(|byte| char::from(*byte)).collect();
                (Cow::Owned(text), Text::Latin1)
            }
        };
        Csv::read(name, text, kind, layout, used)
    }

    /// Reads the rows of `text`.
    fn read(
        name: &str,
        text: Cow<'a, str>,
        kind: Text,
        layout: &'a Layout,
        used: &[&Selector],
    ) -> Result<Csv<'a>, BadInput> {
        let mut csv = Csv {
            layout,
            kind,
            text: Cow::Borrowed(""),
            names: Vec::new(),
            columns: Vec::new(),
        };
        let bad = |line: usize, error: csv::Error| BadInput {
            line: Some(line),
            ..BadInput::file(name, format!("CSV, {error}"))
        };
        let mut rows = Rows::of(&text, layout);
        let mut cells = csv::StringRecord::new();
        if layout.header
            && rows
                .next(&mut cells)
                .map_err(|error| bad(rows.line(), error))?
        {
            csv.names = cells.iter().map(|cell| cell.trim().to_owned()).collect();
        }
        if layout.header && csv.names.is_empty() {
            let expected = "a line with names of columns, found the end of the file";
            return Err(BadInput::file(name, expected));
        }
        for _ in 0..layout.skip_after_header {
            rows.next(&mut cells)
                .map_err(|error| bad(rows.line(), error))?;
        }
        let (mut columns, mut row) = (Vec::new(), 0);
        while rows
            .next(&mut cells)
            .map_err(|error| bad(rows.line(), error))?
        {
            if row == 0 {
                if csv.names.is_empty() {
                    let numbers = 1..=cells.len();
                    csv.names = numbers.map(|number| format!("column {number}")).collect();
                }
                columns = csv.empty_columns(used);
            }
            // Comments may stand beside a sheet's table.
            let beyond = cells.iter().skip(csv.names.len());
            if kind != Text::Sheet && beyond.clone().any(|cell| !cell.trim().is_empty()) {
                let expected = format!(
                    "{} cells as in the first row, found {}; lines above the names need \
                     `skip_lines`, decimal commas another delimiter",
                    csv.names.len(),
                    cells.len()
                );
                return Err(BadInput {
                    line: Some(rows.line()),
                    ..BadInput::file(name, expected)
                });
            }
            for column in columns.iter_mut().filter(|column| column.bad.is_none()) {
                // By the reader it would take an allocation a row.
                match csv.number(cells.get(column.index).map(str::trim)) {
                    Ok(value) => column.values.push(value),
                    Err(why) => column.bad = Some((row, why)),
                }
            }
            row += 1;
        }
        if row == 0 {
            columns = csv.empty_columns(used);
        }
        (csv.columns, csv.text) = (columns, text);
        Ok(csv)
    }

    /// The columns that are used, without numbers.
    fn empty_columns(&self, used: &[&Selector]) -> Vec<Numbers> {
        let mut columns: Vec<Numbers> = Vec::new();
        for index in used.iter().filter_map(|used| self.find(used)) {
            match columns.iter_mut().find(|column| column.index == index) {
                Some(column) => column.uses += 1,
                None => columns.push(Numbers {
                    index,
                    values: Vec::new(),
                    bad: None,
                    uses: 1,
                }),
            }
        }
        columns
    }

    /// The numbers of a column: a copy, unless it is asked for the last time.
    ///
    /// # Errors
    /// The file lacks the column, or has a cell that is no number, with its row.
    fn take(&mut self, selector: &Selector) -> Result<Vec<f64>, (Option<usize>, String)> {
        let index = self
            .find(selector)
            .ok_or_else(|| (None, self.not_found(selector)))?;
        let column = self
            .columns
            .iter_mut()
            .find(|column| column.index == index && column.uses > 0)
            .ok_or_else(|| (None, "a column that is used".into()))?;
        if let Some((row, why)) = &column.bad {
            return Err((Some(*row), why.clone()));
        }
        column.uses -= 1;
        Ok(match column.uses {
            0 => std::mem::take(&mut column.values),
            _ => column.values.clone(),
        })
    }

    /// The line of a row.
    fn line(&self, row: usize) -> usize {
        let mut rows = Rows::of(&self.text, self.layout);
        let mut cells = csv::StringRecord::new();
        let before = usize::from(self.layout.header) + self.layout.skip_after_header;
        for _ in 0..=before + row {
            // It was read before.
            let _ = rows.next(&mut cells);
        }
        rows.line()
    }

    fn find(&self, selector: &Selector) -> Option<usize> {
        match selector {
            Selector::Number(number) => number.checked_sub(1).filter(|i| *i < self.names.len()),
            Selector::Name(name) => self.names.iter().position(|known| known == name),
        }
    }

    /// What is expected of a mapping whose `selector` is not found.
    fn not_found(&self, selector: &Selector) -> String {
        let is_number = |name: &String| name.replace(',', ".").parse::<f64>().is_ok();
        if let [name] = &self.names[..]
            && let Some(delimiter) = name.chars().find(|c| [';', '\t', ',', '|'].contains(c))
        {
            return format!("one of `{name}`, found none; is `file.delimiter` {delimiter:?}?");
        }
        let mut expected = one_of_names(&self.names, selector);
        if self.layout.header && self.names.iter().all(is_number) {
            expected += "; without a line of names `file.header = false` numbers the columns";
        }
        expected
    }

    /// The number in a cell; NaN if the cell has none.
    fn number(&self, cell: Option<&str>) -> Result<f64, String> {
        let cell = cell.ok_or("this cell, found the end of the row")?;
        let is_missing = self.layout.missing.iter().any(|missing| missing == cell);
        if cell.is_empty() || is_missing || cell.eq_ignore_ascii_case("nan") {
            return Ok(f64::NAN);
        }
        let point = match self.layout.decimal_comma {
            true if cell.contains('.') => Err(()),
            true => Ok(Cow::Owned(cell.replacen(',', ".", 1))),
            false => Ok(Cow::Borrowed(cell)),
        };
        let number = point.ok().and_then(|text| text.parse().ok());
        number.ok_or_else(|| {
            let comma = if self.layout.decimal_comma {
                " with a decimal comma"
            } else {
                ""
            };
            format!("a number{comma} or an empty cell, found `{cell}`")
        })
    }
}

impl Variables {
    /// The numbers of a variable's column, or of a vector.
    ///
    /// # Errors
    /// What was expected: another name, more numbers than a file of its size has, a damaged file.
    fn read(&mut self, selector: &Selector) -> Result<Vec<f64>, String> {
        let (index, number) = self.find(selector).ok_or_else(|| {
            let names: Vec<_> = self.variables.iter().map(Variable::words).collect();
            one_of_names(&names, selector)
        })?;
        let (variable, max) = (&self.variables[index], self.numbers_max);
        let (height, width) = (variable.height, variable.width);
        let count = height.checked_mul(width);
        let left = count.and_then(|count| self.numbers_left.checked_sub(count));
        let (Some(count), Some(left)) = (count, left) else {
            return Err(format!(
                "at most {max} numbers of a file of its size, found {height} × {width}"
            ));
        };
        self.numbers_left = left;
        let values = variable.values.get(count, max)?;
        Ok(match number {
            None => values.into_owned(),
            Some(number) => {
                let rows = (number - 1) * height..number * height;
                values.get(rows).unwrap_or_default().to_vec()
            }
        })
    }

    /// Finds a vector by its name, a column of a matrix by `name(:,number)`, numbered from 1.
    fn find(&self, selector: &Selector) -> Option<(usize, Option<usize>)> {
        let Selector::Name(wanted) = selector else {
            return None;
        };
        let (name, number) = match wanted
            .strip_suffix(')')
            .and_then(|name| name.split_once("(:,"))
        {
            Some((name, number)) => (name, Some(number.trim().parse::<usize>().ok()?)),
            None => (wanted.as_str(), None),
        };
        let mut variables = self.variables.iter();
        let index = variables.position(|variable| variable.name == name)?;
        let variable = &self.variables[index];
        let is_there = match number {
            None => variable.is_vector(),
            Some(number) => (1..=variable.width).contains(&number),
        };
        is_there.then_some((index, number))
    }
}

/// What is expected in place of a `selector` that is none of `names`.
fn one_of_names(names: &[String], selector: &Selector) -> String {
    let listed: Vec<_> = names.iter().map(|name| format!("`{name}`")).collect();
    let similar = match selector {
        Selector::Name(found) => {
            let names: Vec<_> = names.iter().map(String::as_str).collect();
            did_you_mean(found, &names)
        }
        Selector::Number(_) => String::new(),
    };
    format!("one of {}, found none{similar}", listed.join(", "))
}

/// Reads rows and knows their lines.
struct Rows<'a> {
    text: &'a [u8],
    reader: csv::Reader<&'a [u8]>,
    first_line: usize,
    /// Where the row begins that was read last.
    begin: usize,
}

impl<'a> Rows<'a> {
    /// The rows of a file from its header on.
    fn of(text: &'a str, layout: &Layout) -> Rows<'a> {
        let text = text.strip_prefix(BYTE_ORDER_MARK).unwrap_or(text);
        let lines = text.split_inclusive('\n').take(layout.skip_lines);
        let skipped: usize = lines.map(str::len).sum();
        let text = &text.as_bytes()[skipped..];
        let reader = csv::ReaderBuilder::new()
            .has_headers(false)
            .flexible(true)
            .delimiter(*layout.delimiter.get_ref() as u8)
            .from_reader(text);
        Rows {
            text,
            reader,
            first_line: 1 + layout.skip_lines,
            begin: 0,
        }
    }

    /// Reads a row into `cells`; false at the end.
    fn next(&mut self, cells: &mut csv::StringRecord) -> Result<bool, csv::Error> {
        let is_row = self.reader.read_record(cells)?;
        if is_row {
            self.begin = row_start(self.text, cells.position());
        }
        Ok(is_row)
    }

    /// The line of the row that was read last.
    fn line(&self) -> usize {
        self.first_line + newlines(&self.text[..self.begin])
    }
}
