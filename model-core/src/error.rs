//! Errors of settings.

use core::fmt;

/// Why settings were refused.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum SettingsError {
    /// A value is not a number or outside its limits.
    OutOfRange {
        /// The value's name.
        name: &'static str,
        /// Smallest value that is accepted.
        min: f32,
        /// Largest value that is accepted.
        max: f32,
    },
    /// A value contradicts another one.
    Contradiction {
        /// The value's name.
        name: &'static str,
        /// What it must be.
        must: &'static str,
    },
    /// The bytes were written by another version.
    Version(u16),
    /// The bytes are damaged.
    Checksum,
    /// The bytes are too few or too many, or the buffer is too short.
    Length,
}

impl fmt::Display for SettingsError {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        match self {
            SettingsError::OutOfRange { name, min, max } => {
                write!(f, "{name}: expected a number from {min} to {max}")
            }
            SettingsError::Contradiction { name, must } => write!(f, "{name}: must be {must}"),
            SettingsError::Version(version) => write!(f, "settings of version {version}"),
            SettingsError::Checksum => write!(f, "settings are damaged"),
            SettingsError::Length => write!(f, "settings have the wrong length"),
        }
    }
}

impl core::error::Error for SettingsError {}
