//! Refuses other formats than CSV if the feature `formats` is off.

use super::variable::Content;
use super::{BadInput, Layout, Selector};

/// How the formats begin that the feature reads: MATLAB 5, MCAP, and xlsx as ZIP.
const BEGINS: [&[u8]; 3] = [b"MATLAB 5.0", b"\x89MCAP0\r\n", b"PK\x03\x04"];
/// The signature of an HDF5 file (HDF5 file format specification, II.A).
const HDF5: &[u8] = b"\x89HDF\r\n\x1a\n";

/// `None` if the bytes are of no format that the feature reads.
///
/// # Errors
/// They are: this program does not read them.
pub(super) fn read(
    name: &str,
    bytes: &[u8],
    _layout: &Layout,
    _used: &[&Selector],
) -> Result<Option<Content>, BadInput> {
    if BEGINS.iter().any(|begin| bytes.starts_with(begin))
        || bytes.windows(HDF5.len()).take(1025).any(|w| w == HDF5)
    {
        let expected = "a CSV file, as this hil-sim was built without the feature `formats`";
        return Err(BadInput::file(name, expected));
    }
    Ok(None)
}

/// How many numbers are read at most: no file has variables.
pub(super) fn numbers_max(_length: usize) -> usize {
    0
}
