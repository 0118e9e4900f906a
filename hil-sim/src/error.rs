//! Errors of the user's input, in one line with file, line, and column or key.

use std::fmt;

/// Bad input, which the user must correct: exit status 2.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct BadInput {
    /// The file, as it was named.
    pub file: String,
    /// Its line, from 1.
    pub line: Option<usize>,
    /// The place in it: ``column `contraction` `` or ``key `load.mass_kg` ``.
    pub place: Option<String>,
    /// What was expected there, and what was found.
    pub expected: String,
}

impl std::error::Error for BadInput {}

impl fmt::Display for BadInput {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        write!(f, "{}", one_line(&self.file))?;
        if let Some(line) = self.line {
            write!(f, ":{line}")?;
        }
        if let Some(place) = &self.place {
            write!(f, ": {}", one_line(place))?;
        }
        write!(f, ": expected {}", one_line(&self.expected))
    }
}

impl BadInput {
    /// A file that could not be opened or written.
    pub fn file(file: impl Into<String>, expected: impl Into<String>) -> BadInput {
        BadInput {
            file: file.into(),
            line: None,
            place: None,
            expected: expected.into(),
        }
    }

    /// This error and `other`, of the same file, as one.
    #[must_use]
    pub fn and(mut self, other: BadInput) -> BadInput {
        self.expected += ";";
        if let Some(line) = other.line {
            self.expected += &format!(" line {line}:");
        }
        if let Some(place) = &other.place {
            self.expected += &format!(" {place}:");
        }
        self.expected += &format!(" expected {}", other.expected);
        self
    }
}

/// What is expected where `found` is none of the `known` names.
pub fn one_of(known: &[&str], found: &str) -> String {
    let listed = known.join(", ");
    format!("one of {listed}, found \"{found}\"") + &did_you_mean(found, known)
}

/// The `known` name that `found` was probably meant to be, as the end of a message; empty if there
/// is none.
pub(crate) fn did_you_mean(found: &str, known: &[&str]) -> String {
    let edits = |known: &&&str| strsim::osa_distance(found, known);
    let is_similar = |known: &&&str| {
        // As rustc: a misspelling changes at most a third of the characters. A key without its
        // unit is the start of the right one.
        3 * edits(known) <= found.len().max(known.len()) || known.starts_with(found)
    };
    let nearest = known.iter().filter(is_similar).min_by_key(edits);
    nearest.map_or_else(String::new, |name| format!(": did you mean {name}?"))
}

/// `value` as messages have it: scientific only where it is very small or large.
pub(crate) fn shown(value: f64) -> String {
    if value == 0.0 || (1e-4..1e5).contains(&value.abs()) {
        value.to_string()
    } else {
        format!("{value:e}")
    }
}

/// A number with four significant digits.
pub(crate) fn significant(value: f64) -> String {
    if value == 0.0 {
        return "0".into();
    }
    let before_point = value.abs().max(1e-9).log10().floor() as i32;
    format!("{value:.*}", (3 - before_point).clamp(0, 9) as usize)
}

/// `text` with everything that would break a line escaped, and cut if a file made it endless.
fn one_line(text: &str) -> String {
    // Lists of names stay whole: the names of all effects have 320 characters.
    const LENGTH_MAX: usize = 2000;
    let mut line = String::new();
    for character in text.chars().take(LENGTH_MAX) {
        if character.is_control() || character == '\u{2028}' || character == '\u{2029}' {
            line.extend(character.escape_default());
        } else {
            line.push(character);
        }
    }
    if text.chars().nth(LENGTH_MAX).is_some() {
        line.push('…');
    }
    line
}
