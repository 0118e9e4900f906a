//! Sheets of xlsx workbooks, as CSV text.
//!
//! The parts of a workbook are unpacked within a limit before calamine reads them.

use super::super::variable::Content;
use super::{BadInput, Layout, unpacked_max};
use calamine::{DataRef, Reader, Xlsx};
use std::io::{Cursor, Read, Write};
use zip::write::SimpleFileOptions;
use zip::{CompressionMethod, ZipArchive, ZipWriter};

/// A part that each Office Open XML file has.
const CONTENT_TYPES: &str = "[Content_Types].xml";

/// Whether the bytes are of a ZIP file.
pub(super) fn is_zip(bytes: &[u8]) -> bool {
    bytes.starts_with(b"PK\x03\x04")
}

/// The sheet `layout.sheet`, or the first, of the workbook `name` as CSV with the delimiter and the
/// decimal character of `layout`: one line for each row from the first. `None` if the bytes are not
/// of Office Open XML.
///
/// # Errors
/// The workbook is damaged, lacks the sheet, or is too large for a file of its size.
pub(super) fn read(name: &str, bytes: &[u8], layout: &Layout) -> Result<Option<Content>, BadInput> {
    if !is_zip(bytes) {
        return Ok(None);
    }
    let bad = |why: String| BadInput::file(name, format!("an xlsx workbook, {why}"));
    let max = unpacked_max(bytes.len());
    let Some(parts) = parts(bytes, max).map_err(bad)? else {
        return Ok(None);
    };
    let mut book = Xlsx::new(Cursor::new(parts)).map_err(|error| bad(error.to_string()))?;
    let sheets = book.sheet_names();
    let sheet = match &layout.sheet {
        Some(sheet) => sheets.iter().find(|name| *name == sheet),
        None => sheets.first(),
    };
    let Some(sheet) = sheet else {
        let wanted = layout.sheet.as_deref().unwrap_or("sheet");
        let expected = format!("a `file.sheet` of {sheets:?}, found `{wanted}`");
        return Err(BadInput::file(name, expected));
    };
    let text = text(&mut book, sheet, layout, max).map_err(bad)?;
    let mut notes = vec![format!("Sheet `{sheet}`.")];
    if sheets.len() > 1 {
        let others = sheets.iter().filter(|name| *name != sheet);
        let others: Vec<_> = others.map(|name| format!("`{name}`")).collect();
        notes[0] += &format!(" `file.sheet` takes another: {}.", others.join(", "));
    }
    Ok(Some(Content::Text {
        text,
        format: "xlsx",
        notes,
    }))
}

/// The XML parts of the workbook, in a ZIP file without compression; `None` if it is no workbook.
///
/// # Errors
/// A damaged file, or one whose parts have more than `max` bytes.
fn parts(bytes: &[u8], max: usize) -> Result<Option<Vec<u8>>, String> {
    let words = |error: &dyn std::fmt::Display| format!("a ZIP file, {error}");
    let mut packed = ZipArchive::new(Cursor::new(bytes)).map_err(|error| words(&error))?;
    if packed.index_for_name(CONTENT_TYPES).is_none() {
        return Ok(None);
    }
    let mut parts = ZipWriter::new(Cursor::new(Vec::new()));
    let options = SimpleFileOptions::default().compression_method(CompressionMethod::Stored);
    let mut left = max;
    for index in 0..packed.len() {
        let part = packed.by_index(index).map_err(|error| words(&error))?;
        let name = part.name().map_err(|error| words(&error))?.into_owned();
        if !name.ends_with(".xml") && !name.ends_with(".rels") {
            continue;
        }
        let mut unpacked = Vec::new();
        let limit = left as u64 + 1;
        let read = part.take(limit).read_to_end(&mut unpacked);
        read.map_err(|error| words(&error))?;
        let rest = left.checked_sub(unpacked.len());
        left = rest.ok_or_else(|| format!("at most {max} unpacked bytes, found more"))?;
        if name.ends_with("sharedStrings.xml") {
            disregard_count(&mut unpacked);
        }
        let begun = parts.start_file(name, options);
        begun.map_err(|error| words(&error))?;
        parts.write_all(&unpacked).map_err(|error| words(&error))?;
    }
    let parts = parts.finish().map_err(|error| words(&error))?;
    Ok(Some(parts.into_inner()))
}

/// Renames the attribute with the number of texts: calamine allocates whatever it says.
fn disregard_count(part: &mut [u8]) {
    const COUNT: &[u8] = b"uniqueCount";
    let mut from = 0;
    while let Some(at) = part[from..].windows(COUNT.len()).position(|w| w == COUNT) {
        from += at;
        part[from] = b'U';
    }
}

/// The cells of a sheet as CSV of at most `max` bytes.
fn text(
    book: &mut Xlsx<Cursor<Vec<u8>>>,
    sheet: &str,
    layout: &Layout,
    max: usize,
) -> Result<String, String> {
    let words = |error: calamine::XlsxError| error.to_string();
    let delimiter = *layout.delimiter.get_ref();
    let mut cells = book.worksheet_cells_reader(sheet).map_err(words)?;
    // Row, number of its cells, and of those of the longest row so far.
    let (mut text, mut row, mut written, mut width) = (String::new(), 0, 0, 0);
    while let Some(cell) = cells.next_cell().map_err(words)? {
        let Some(value) = of_cell(cell.get_value(), layout.decimal_comma) else {
            continue;
        };
        let (at_row, at_column) = cell.get_position();
        if at_row < row || at_row == row && at_column < written {
            return Err("rows and cells in order, found others".into());
        }
        // Before anything is written: a cell may claim any row and column.
        let below = (at_row - row) as usize;
        if text.len() + below + at_column as usize + width as usize + value.len() > max {
            return Err(format!("cells of at most {max} bytes, found more"));
        }
        if row < at_row {
            end_row(&mut text, written, width, delimiter);
            text.extend((row + 1..at_row).map(|_| '\n'));
            (row, written) = (at_row, 0);
        }
        let skipped = at_column - written + u32::from(written > 0);
        // The first cell of a row has no delimiter before it.
        text.extend((0..skipped).map(|_| delimiter));
        text += &in_quotes(&value, delimiter);
        written = at_column + 1;
        width = width.max(written);
    }
    end_row(&mut text, written, width, delimiter);
    Ok(text)
}

/// Ends a row that has `written` cells with empty ones, unless all are.
fn end_row(text: &mut String, written: u32, width: u32, delimiter: char) {
    if written > 0 {
        text.extend((written..width).map(|_| delimiter));
    }
    text.push('\n');
}

/// The text of a cell; `None` if it is empty. Dates and times of day are numbers of days.
fn of_cell(value: &DataRef, decimal_comma: bool) -> Option<String> {
    let number = |number: f64| {
        let text = match number.abs() {
            0.0 | 1e-5..1e15 => number.to_string(),
            _ => format!("{number:e}"),
        };
        match decimal_comma {
            true => text.replace('.', ","),
            false => text,
        }
    };
    let text = match value {
        DataRef::Empty => return None,
        DataRef::Int(integer) => integer.to_string(),
        DataRef::Float(float) => number(*float),
        DataRef::DateTime(days) => number(days.as_f64()),
        DataRef::Bool(is_true) => u8::from(*is_true).to_string(),
        DataRef::String(text) | DataRef::DateTimeIso(text) | DataRef::DurationIso(text) => {
            text.clone()
        }
        DataRef::SharedString(text) => (*text).into(),
        DataRef::Error(error) => error.to_string(),
    };
    (!text.is_empty()).then_some(text)
}

/// The text of a cell in one line, in quotes where CSV needs them.
fn in_quotes(text: &str, delimiter: char) -> String {
    let text = text.replace(['\r', '\n'], " ");
    match text.contains([delimiter, '"']) {
        true => format!("\"{}\"", text.replace('"', "\"\"")),
        false => text,
    }
}
