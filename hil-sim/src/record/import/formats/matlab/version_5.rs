//! MATLAB files of versions 5 to 7: «MAT-File Format», The MathWorks, 2019.

use super::super::super::variable::{Values, Variable};
use std::io::Read;

/// Length of the header, whose last two bytes tell the byte order.
const HEADER: usize = 128;
/// Structs within each other.
const DEPTH_MAX: usize = 4;

/// Types of elements (table 1-1 of the format).
const INT8: u32 = 1;
const INT32: u32 = 5;
const UINT32: u32 = 6;
const MATRIX: u32 = 14;
const COMPRESSED: u32 = 15;
/// Classes of arrays (table 1-3): struct, and those of numbers.
const STRUCT: u32 = 2;
const NUMBERS: std::ops::RangeInclusive<u32> = 6..=15;

/// The numeric arrays of two dimensions in a file, a struct's field as `struct.field`; of at most
/// `numbers_max` numbers.
///
/// # Errors
/// What was expected of a damaged file, and what was found.
pub(super) fn read(bytes: &[u8], numbers_max: usize) -> Result<Vec<Variable>, String> {
    let is_little = match bytes.get(HEADER - 2..HEADER) {
        Some(b"IM") => true,
        Some(b"MI") => false,
        _ => return Err("`IM` or `MI` at the end of its header, found neither".into()),
    };
    let mut found = Found {
        variables: Vec::new(),
        numbers_left: numbers_max,
    };
    // Numbers of one byte are the smallest; unpacked data are held one variable at a time.
    let mut unpacked_left = 8 * numbers_max;
    let mut elements = Elements {
        bytes: &bytes[HEADER..],
        is_little,
    };
    while let Some(element) = elements.next(false)? {
        match element.kind {
            MATRIX => found.matrix(&element, "", 0)?,
            COMPRESSED => {
                let mut unpacked = Vec::new();
                let limit = unpacked_left as u64 + 1;
                flate2::read::ZlibDecoder::new(element.bytes)
                    .take(limit)
                    .read_to_end(&mut unpacked)
                    .map_err(|error| format!("packed data, {error}"))?;
                unpacked_left = unpacked_left
                    .checked_sub(unpacked.len())
                    .ok_or_else(|| format!("at most {} unpacked bytes, found more", limit - 1))?;
                let mut inner = Elements {
                    bytes: &unpacked,
                    is_little,
                };
                if let Some(inner) = inner.next(false)?
                    && inner.kind == MATRIX
                {
                    found.matrix(&inner, "", 0)?;
                }
            }
            _ => {}
        }
    }
    Ok(found.variables)
}

/// One element of a file.
struct Element<'a> {
    kind: u32,
    bytes: &'a [u8],
    is_little: bool,
}

impl<'a> Element<'a> {
    /// The elements in this one.
    fn inner(&self) -> Elements<'a> {
        Elements {
            bytes: self.bytes,
            is_little: self.is_little,
        }
    }

    fn numbers<const N: usize>(&self, convert: fn([u8; N], bool) -> f64) -> Vec<f64> {
        let (chunks, _) = self.bytes.as_chunks::<N>();
        chunks
            .iter()
            .map(|chunk| convert(*chunk, self.is_little))
            .collect()
    }

    /// Its numbers; `None` if it has none.
    fn to_f64(&self) -> Option<Vec<f64>> {
        // Measured values are exact in 53 bits.
        macro_rules! of {
            ($number:ty) => {
                self.numbers(|bytes, is_little| match is_little {
                    true => <$number>::from_le_bytes(bytes) as f64,
                    false => <$number>::from_be_bytes(bytes) as f64,
                })
            };
        }
        Some(match self.kind {
            INT8 => of!(i8),
            2 => of!(u8),
            3 => of!(i16),
            4 => of!(u16),
            INT32 => of!(i32),
            UINT32 => of!(u32),
            7 => of!(f32),
            9 => of!(f64),
            12 => of!(i64),
            13 => of!(u64),
            _ => return None,
        })
    }

    /// Bytes of one number; 0 of other types.
    fn width(&self) -> usize {
        match self.kind {
            INT8 | 2 => 1,
            3 | 4 => 2,
            INT32 | UINT32 | 7 => 4,
            9 | 12 | 13 => 8,
            _ => 0,
        }
    }

    /// Its whole numbers, as dimensions and flags are.
    fn integers(&self, kind: u32, expected: &str) -> Result<Vec<usize>, String> {
        let numbers = self.to_f64().filter(|_| self.kind == kind);
        let numbers = numbers.filter(|numbers| numbers.iter().all(|number| *number >= 0.0));
        let numbers = numbers.ok_or_else(|| format!("{expected}, found none"))?;
        Ok(numbers.into_iter().map(|number| number as usize).collect())
    }

    fn text(&self) -> String {
        String::from_utf8_lossy(self.bytes).into_owned()
    }
}

/// Elements one after the other.
struct Elements<'a> {
    bytes: &'a [u8],
    is_little: bool,
}

impl<'a> Elements<'a> {
    fn word(&self, at: usize) -> Option<u32> {
        let word = self.bytes.get(at..at + 4)?.try_into().ok()?;
        Some(match self.is_little {
            true => u32::from_le_bytes(word),
            false => u32::from_be_bytes(word),
        })
    }

    /// The next element; those in others are padded to eight bytes, as are matrices.
    fn next(&mut self, is_inner: bool) -> Result<Option<Element<'a>>, String> {
        let (Some(first), Some(second)) = (self.word(0), self.word(4)) else {
            return Ok(None);
        };
        // A small element has its length in the upper half of its type, and four bytes.
        let (kind, length, begin) = match first >> 16 {
            0 => (first, second as usize, 8),
            length => (first & 0xFFFF, length as usize, 4),
        };
        let end = begin + length;
        if begin == 4 && length > 4 || end > self.bytes.len() {
            let rest = self.bytes.len();
            return Err(format!("{end} bytes of an element, found {rest}"));
        }
        let is_padded = is_inner || kind != COMPRESSED;
        let next = if is_padded {
            end.next_multiple_of(8)
        } else {
            end
        };
        let element = Element {
            kind,
            bytes: &self.bytes[begin..end],
            is_little: self.is_little,
        };
        self.bytes = self.bytes.get(next..).unwrap_or_default();
        Ok(Some(element))
    }

    /// As [`Elements::next`], of an array's parts.
    fn part(&mut self, what: &str) -> Result<Element<'a>, String> {
        self.next(true)?
            .ok_or_else(|| format!("an array's {what}, found the end"))
    }
}

/// What was found so far.
struct Found {
    variables: Vec<Variable>,
    numbers_left: usize,
}

impl Found {
    /// Adds the array in `element`, or the fields of a struct, whose names begin with `prefix`.
    fn matrix(&mut self, element: &Element, prefix: &str, depth: usize) -> Result<(), String> {
        let mut parts = element.inner();
        if parts.bytes.is_empty() {
            return Ok(());
        }
        let flags = parts.part("flags")?.integers(UINT32, "an array's flags")?;
        let class = flags.first().map_or(0, |flags| flags & 0xFF) as u32;
        let dimensions = parts.part("size")?.integers(INT32, "an array's size")?;
        let own = parts.part("name")?.text();
        let name = match own.is_empty() {
            true => prefix.to_owned(),
            false => format!("{prefix}{own}"),
        };
        let (height, width) = match dimensions[..] {
            [height, width] => (height, width),
            _ => return Ok(()),
        };
        if class == STRUCT && height == 1 && width == 1 && depth < DEPTH_MAX {
            return self.fields(&mut parts, &name, depth);
        }
        if !NUMBERS.contains(&class) {
            return Ok(());
        }
        let data = parts.part("numbers")?;
        let count = data.bytes.len() / data.width().max(1);
        if data.width() == 0 || height.checked_mul(width) != Some(count) {
            return Err(format!(
                "{height} × {width} numbers in `{name}`, found {count}"
            ));
        }
        self.numbers_left = self
            .numbers_left
            .checked_sub(count)
            .ok_or("fewer numbers for a file of its size, found more")?;
        self.variables.push(Variable {
            name,
            height,
            width,
            values: Values::Read(data.to_f64().unwrap_or_default()),
        });
        Ok(())
    }

    /// Adds the fields of the struct `name`.
    fn fields(&mut self, parts: &mut Elements, name: &str, depth: usize) -> Result<(), String> {
        let length = parts.part("length of names")?;
        let length = length.integers(INT32, "the length of names")?;
        let length = length.first().copied().unwrap_or(0).max(1);
        let names = parts.part("names of fields")?;
        for field in names.bytes.chunks(length) {
            let end = field.iter().position(|byte| *byte == 0);
            let field = String::from_utf8_lossy(&field[..end.unwrap_or(field.len())]);
            let value = parts.part("field")?;
            if value.kind == MATRIX {
                self.matrix(&value, &format!("{name}.{field}"), depth + 1)?;
            }
        }
        Ok(())
    }
}
