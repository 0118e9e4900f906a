//! Reading of the files that can be imported, as columns of numbers.

use super::{BadInput, Layout, Selector, matlab};
use crate::record::{newlines, row_start};
use std::borrow::Cow;

/// The columns of one file.
pub(super) struct Source {
    file: String,
    kind: Kind,
}

enum Kind {
    Csv(Csv),
    /// Variables, and the format's name.
    Mat(Vec<Variable>, &'static str),
}

/// A CSV file with its cells as text.
struct Csv {
    decimal_comma: bool,
    missing: Vec<String>,
    is_latin_1: bool,
    names: Vec<String>,
    rows: Vec<csv::StringRecord>,
    lines: Vec<usize>,
}

/// One variable of a MATLAB file: `values` column by column.
pub(super) struct Variable {
    pub(super) name: String,
    pub(super) height: usize,
    pub(super) width: usize,
    pub(super) values: Vec<f64>,
}

impl Source {
    /// Reads the `bytes` of the file `name`; their first bytes tell the format.
    ///
    /// # Errors
    /// The bytes are not of the format, with line.
    pub fn open(name: &str, bytes: &[u8], layout: &Layout) -> Result<Source, BadInput> {
        let kind = match matlab::read(name, bytes)? {
            Some((variables, format)) => Kind::Mat(variables, format),
            None => Kind::Csv(Csv::open(name, bytes, layout)?),
        };
        Ok(Source {
            file: name.into(),
            kind,
        })
    }

    pub fn format(&self) -> &'static str {
        match &self.kind {
            Kind::Csv(_) => "CSV",
            Kind::Mat(_, format) => format,
        }
    }

    pub fn encoding(&self) -> Option<&'static str> {
        matches!(
            &self.kind,
            Kind::Csv(Csv {
                is_latin_1: true,
                ..
            })
        )
        .then_some("Latin-1")
    }

    /// The position of a row: its line in a CSV file, else its number from 1.
    pub fn place(&self, row: usize) -> usize {
        match &self.kind {
            Kind::Csv(csv) => csv.lines[row],
            Kind::Mat(..) => row + 1,
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
            Kind::Mat(..) => self.bad_column(&format!("{name}, row {place}"), expected),
        }
    }

    /// Bad input in the column `name`.
    pub fn bad_column(&self, name: &str, expected: &str) -> BadInput {
        BadInput {
            place: Some(name.into()),
            ..BadInput::file(&self.file, expected)
        }
    }

    /// A column's name in messages and its numbers, one per row, NaN where one is missing.
    ///
    /// # Errors
    /// The file lacks the column, the column has no row, or a cell is not a finite number.
    pub fn column(&self, selector: &Selector) -> Result<(String, Vec<f64>), BadInput> {
        let name = selector.to_string();
        let values = match &self.kind {
            Kind::Csv(csv) => {
                let index = csv.find(selector).ok_or_else(|| {
                    let expected = format!("one of {}, found none", csv.names.join(", "));
                    self.bad_column(&name, &expected)
                })?;
                let rows = csv.rows.iter().enumerate();
                let cells = rows.map(|(row, cells)| {
                    csv.number(cells.get(index))
                        .map_err(|why| self.bad(row, &name, &why))
                });
                cells.collect::<Result<_, _>>()?
            }
            Kind::Mat(variables, _) => {
                let (_, values) = find(variables, selector).ok_or_else(|| {
                    let names: Vec<_> = variables.iter().map(Variable::words).collect();
                    let expected = format!("one of {}, found none", names.join(", "));
                    self.bad_column(&name, &expected)
                })?;
                values.to_vec()
            }
        };
        if values.is_empty() {
            return Err(self.bad_column(&name, "at least one row of samples, found none"));
        }
        if let Some(row) = values.iter().position(|value| value.is_infinite()) {
            return Err(self.bad(row, &name, "a finite number, found an infinite one"));
        }
        Ok((name, values))
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
            Kind::Mat(variables, _) => {
                let used = used.iter().filter_map(|used| find(variables, used));
                let used: Vec<_> = used.map(|(index, _)| index).collect();
                let rest = variables.iter().enumerate();
                let rest = rest.filter(|(index, _)| !used.contains(index));
                rest.map(|(_, variable)| variable.words()).collect()
            }
        }
    }
}

impl Csv {
    fn open(name: &str, bytes: &[u8], layout: &Layout) -> Result<Csv, BadInput> {
        if bytes.starts_with(b"\xff\xfe") || bytes.starts_with(b"\xfe\xff") {
            return Err(BadInput::file(
                name,
                "text in UTF-8 or Latin-1, found UTF-16",
            ));
        }
        let bytes = bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(bytes);
        let utf_8 = std::str::from_utf8(bytes);
        let is_latin_1 = utf_8.is_err();
        let text = utf_8.map_or_else(
            // Latin-1 is the first 256 code points of Unicode.
            |_| Cow::Owned(bytes.iter().map(|byte| char::from(*byte)).collect()),
            Cow::Borrowed,
        );
        let mut head = text.split_inclusive('\n').take(layout.skip_lines);
        let skipped: usize = head.by_ref().map(str::len).sum();
        let text = &text.as_bytes()[skipped..];
        let mut reader = csv::ReaderBuilder::new()
            .has_headers(false)
            .flexible(true)
            .trim(csv::Trim::All)
            .delimiter(*layout.delimiter.get_ref() as u8)
            .from_reader(text);
        let mut csv = Csv {
            decimal_comma: layout.decimal_comma,
            missing: layout.missing.clone(),
            is_latin_1,
            names: Vec::new(),
            rows: Vec::new(),
            lines: Vec::new(),
        };
        let (mut line, mut counted) = (1 + layout.skip_lines, 0);
        let mut skip = layout.skip_after_header;
        let mut cells = csv::StringRecord::new();
        let mut in_header = layout.header;
        while reader.read_record(&mut cells).map_err(|error| BadInput {
            line: Some(line),
            ..BadInput::file(name, format!("CSV, {error}"))
        })? {
            let begin = row_start(text, cells.position());
            line += newlines(&text[counted..begin]);
            counted = begin;
            if std::mem::take(&mut in_header) {
                csv.names = cells.iter().map(str::to_owned).collect();
            } else if skip > 0 {
                skip -= 1;
            } else {
                csv.rows.push(cells.clone());
                csv.lines.push(line);
            }
        }
        if csv.names.is_empty() {
            let width = csv.rows.first().map_or(0, csv::StringRecord::len);
            csv.names = (1..=width)
                .map(|number| format!("column {number}"))
                .collect();
        }
        Ok(csv)
    }

    fn find(&self, selector: &Selector) -> Option<usize> {
        match selector {
            Selector::Number(number) => number.checked_sub(1).filter(|i| *i < self.names.len()),
            Selector::Name(name) => self.names.iter().position(|known| known == name),
        }
    }

    /// The number in a cell; NaN if the cell has none.
    fn number(&self, cell: Option<&str>) -> Result<f64, String> {
        let cell = cell.ok_or("this cell, found the end of the row")?;
        let is_missing = self.missing.iter().any(|missing| missing == cell);
        if cell.is_empty() || is_missing || cell.eq_ignore_ascii_case("nan") {
            return Ok(f64::NAN);
        }
        let point = match self.decimal_comma {
            true if cell.contains('.') => Err(()),
            true => Ok(Cow::Owned(cell.replacen(',', ".", 1))),
            false => Ok(Cow::Borrowed(cell)),
        };
        let number = point.ok().and_then(|text| text.parse().ok());
        number.ok_or_else(|| {
            let comma = if self.decimal_comma {
                " with a decimal comma"
            } else {
                ""
            };
            format!("a number{comma} or an empty cell, found `{cell}`")
        })
    }
}

impl Variable {
    fn is_vector(&self) -> bool {
        self.height == 1 || self.width == 1
    }

    fn words(&self) -> String {
        if self.is_vector() {
            self.name.clone()
        } else {
            format!("{}(:,1) to (:,{})", self.name, self.width)
        }
    }
}

/// Finds a vector by its name, a column of a matrix by `name(:,number)`.
fn find<'a>(variables: &'a [Variable], selector: &Selector) -> Option<(usize, &'a [f64])> {
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
    let index = variables
        .iter()
        .position(|variable| variable.name == name)?;
    let variable = &variables[index];
    match number {
        None if variable.is_vector() => Some((index, &variable.values)),
        None => None,
        Some(number) => {
            let mut columns = variable.values.chunks_exact(variable.height.max(1));
            Some((index, columns.nth(number.checked_sub(1)?)?))
        }
    }
}
