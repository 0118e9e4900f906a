//! Refuses MATLAB files if the feature `matlab` is off.

use super::BadInput;
use super::variable::Variable;

/// The signature of an HDF5 file (HDF5 file format specification, II.A).
const HDF5: &[u8] = b"\x89HDF\r\n\x1a\n";

/// `None` if the bytes are not of MATLAB.
///
/// # Errors
/// They are: this program does not read them.
pub(super) fn read(
    name: &str,
    bytes: &[u8],
) -> Result<Option<(Vec<Variable>, &'static str)>, BadInput> {
    if bytes.starts_with(b"MATLAB 5.0") || bytes.windows(HDF5.len()).take(1025).any(|w| w == HDF5) {
        let expected = "a CSV file, as this hil-sim was built without the feature `matlab`";
        return Err(BadInput::file(name, expected));
    }
    Ok(None)
}

/// How many numbers are read at most: no file has variables.
pub(super) fn numbers_max(_length: usize) -> usize {
    0
}
