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
}

/// `text` with everything that would break a line escaped, and cut to a readable length.
fn one_line(text: &str) -> String {
    const LENGTH_MAX: usize = 300;
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
