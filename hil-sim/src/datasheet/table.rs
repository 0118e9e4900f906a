//! Tables of a data sheet as CSV, whose columns name their unit.

use crate::error::{BadInput, did_you_mean};
use crate::input;
use crate::record::units::Unit;
use std::path::Path;

/// A column that a table must have.
pub(super) struct Quantity {
    /// Its name, to which a unit is appended.
    pub name: &'static str,
    /// Its units; the first is the one of the values that are returned.
    pub units: &'static [Unit],
    /// The smallest and the largest value in that unit.
    pub range: (f64, f64),
}

impl Quantity {
    /// The names of its column, one for each unit.
    fn columns(&self) -> Vec<String> {
        let column = |(unit, ..): &Unit| match *unit {
            "1" => self.name.into(),
            "%" => format!("{}_percent", self.name),
            unit => format!("{}_{}", self.name, unit.to_lowercase()),
        };
        self.units.iter().map(column).collect()
    }
}

/// The rows of a CSV file with one column for each of `quantities`, in their first unit, and the
/// line of each row. Other columns are ignored.
///
/// # Errors
/// The file cannot be read, a column is missing or is there in two units, a cell is no number or
/// outside its range; with line and column.
pub(super) fn read<const N: usize>(
    path: &Path,
    quantities: [Quantity; N],
) -> Result<Vec<(usize, [f64; N])>, BadInput> {
    let name = path.display().to_string();
    parse(
        &name,
        &input::read(path, "a readable CSV file")?,
        quantities,
    )
}

fn parse<const N: usize>(
    name: &str,
    bytes: &[u8],
    quantities: [Quantity; N],
) -> Result<Vec<(usize, [f64; N])>, BadInput> {
    let bytes = bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(bytes);
    // A row with a semicolon is of a spreadsheet with decimal commas.
    let has_semicolons = bytes.contains(&b';');
    let mut reader = csv::ReaderBuilder::new()
        .delimiter(if has_semicolons { b';' } else { b',' })
        .trim(csv::Trim::All)
        .comment(Some(b'#'))
        .from_reader(bytes);
    let bad = |line: Option<usize>, column: Option<&str>, expected: String| BadInput {
        line,
        place: column.map(|column| format!("column `{column}`")),
        ..BadInput::file(name, expected)
    };
    let line_of = |position: Option<&csv::Position>| position.map(|at| row_line(bytes, at));
    let not_csv = |error: csv::Error| {
        let expected = match error.kind() {
            csv::ErrorKind::Utf8 { .. } => "text in UTF-8, found other bytes".into(),
            csv::ErrorKind::UnequalLengths {
                expected_len, len, ..
            } => format!("CSV with {expected_len} cells in each row, found {len}"),
            _ => format!("CSV, {error}"),
        };
        bad(line_of(error.position()), None, expected)
    };
    let header = reader.headers().map_err(not_csv)?.clone();
    let header_line = line_of(header.position());
    let mut places = Vec::new();
    for quantity in &quantities {
        places.push(place(&header, quantity).map_err(|expected| bad(header_line, None, expected))?);
    }
    let mut rows = Vec::new();
    for row in reader.records() {
        let row = row.map_err(not_csv)?;
        let line = line_of(row.position());
        let mut values = [0.0; N];
        for ((value, quantity), (place, unit)) in values.iter_mut().zip(&quantities).zip(&places) {
            let cell = row.get(*place).unwrap_or_default();
            let column = header.get(*place);
            let (_, size, _) = unit;
            let (min, max) = quantity.range;
            let number = match has_semicolons {
                true => cell.replacen(',', ".", 1).parse::<f64>(),
                false => cell.parse(),
            };
            *value = match number {
                Ok(number) if (min..=max).contains(&(number * size)) => number * size,
                _ => {
                    let (min, max) = (min / size, max / size);
                    let expected = format!("a number from {min} to {max}, found \"{cell}\"");
                    return Err(bad(line, column, expected));
                }
            };
        }
        rows.push((line.unwrap_or(0), values));
    }
    Ok(rows)
}

/// The line of the row that the reader looked for at a position: below comments and empty lines.
fn row_line(bytes: &[u8], position: &csv::Position) -> usize {
    let rest = bytes.get(position.byte() as usize..).unwrap_or_default();
    let lines = rest.split(|byte| *byte == b'\n');
    let skipped = lines.take_while(|line| line.starts_with(b"#") || line.trim_ascii().is_empty());
    // The last line break ends the file.
    let breaks = rest.iter().filter(|byte| **byte == b'\n').count();
    position.line() as usize + skipped.count().min(breaks)
}

/// The place of a quantity's column and its unit, or what is expected of the header.
fn place(header: &csv::StringRecord, quantity: &Quantity) -> Result<(usize, Unit), String> {
    let columns = quantity.columns();
    let mut found = header.iter().enumerate().filter_map(|(place, name)| {
        let unit = columns.iter().position(|column| column == name)?;
        Some((place, quantity.units[unit]))
    });
    match (found.next(), found.next()) {
        (Some(place), None) => Ok(place),
        (Some(_), Some(_)) => Err(format!("one column of {}, found two", columns.join(", "))),
        (None, _) => {
            let known: Vec<_> = columns.iter().map(String::as_str).collect();
            let similar = header.iter().map(|name| did_you_mean(name, &known));
            let meant = similar.max_by_key(String::len).unwrap_or_default();
            let found: Vec<_> = header.iter().collect();
            Err(format!(
                "a column {}, found {}{meant}",
                columns.join(" or "),
                found.join(", ")
            ))
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::record::units::{PRESSURE, RATIO};

    fn read(text: impl AsRef<[u8]>) -> Result<Vec<(usize, [f64; 2])>, BadInput> {
        let quantity = |name, units, range| Quantity { name, units, range };
        let quantities = [
            quantity("contraction", RATIO, (0.0, 0.5)),
            quantity("pressure", PRESSURE, (0.0, 1e7)),
        ];
        parse("table.csv", text.as_ref(), quantities)
    }

    #[test]
    fn units_stand_in_the_names_of_the_columns() {
        let rows = read("# Festo\npressure_bar,note,contraction_percent\n6,a,25\n").expect("rows");
        assert_eq!(rows, [(3, [0.25, 6e5])]);
        let rows = read("contraction,pressure_pa\n0.25,6e5\n").expect("rows");
        assert_eq!(rows, [(2, [0.25, 6e5])]);
    }

    #[test]
    fn a_table_of_a_german_spreadsheet_is_read() {
        let rows = read("pressure_bar;contraction_percent\n6,5;12,5\n").expect("rows");
        assert_eq!(rows, [(2, [0.125, 6.5e5])]);
    }

    /// Not that of the comments and empty lines above it.
    #[test]
    fn a_row_is_counted_at_its_own_line() {
        let text = "# Festo\n\n# DMSP\ncontraction,pressure_pa\n0.25,6e5\n# more\n\n0.2,6e5";
        let rows = read(text).expect("rows");
        let lines: Vec<_> = rows.iter().map(|(line, _)| *line).collect();
        assert_eq!(lines, [5, 8]);
    }

    #[test]
    fn bad_tables_are_refused_with_their_place() {
        for (text, message) in [
            ("contraction,presure_bar\n", "did you mean pressure_bar?"),
            (
                "contraction,pressure_bar,pressure_pa\n",
                "table.csv:1: expected one column of pressure_pa, pressure_hpa,",
            ),
            (
                "contraction,pressure_bar\n25,6\n",
                "table.csv:2: column `contraction`: expected a number from 0 to 0.5, found \"25\"",
            ),
            (
                "contraction,pressure_bar\n0.1,NaN\n",
                "column `pressure_bar`: expected a number from 0 to 100, found \"NaN\"",
            ),
            (
                "contraction,pressure_bar\n0.1\n",
                "table.csv:2: expected CSV with 2 cells in each row, found 1",
            ),
            (
                "# Festo\ncontraction,presure_bar\n",
                "table.csv:2: expected a column pressure_pa",
            ),
            (
                "contraction,pressure_bar\n# more\n0.1,7,8\n",
                "table.csv:3: expected CSV with 2 cells in each row, found 3",
            ),
        ] {
            let error = read(text).expect_err("a bad table").to_string();
            assert!(error.contains(message), "{error}");
        }
        let latin_1 = b"contraction,pressure_bar,note\n0.1,6,\xb5\n";
        let error = read(latin_1).expect_err("not UTF-8").to_string();
        let says = "table.csv:2: expected text in UTF-8, found other bytes";
        assert!(error.contains(says), "{error}");
    }
}
