//! Other formats than CSV, with the feature `formats`.
//!
//! What a small file can cost is bounded: it may state any size, unpack to a thousand times its
//! own, and link to itself.

mod matlab;
mod mcap;
mod ros;
mod xlsx;

use super::variable::{Content, Variable};
use super::{BadInput, Layout, Selector};

/// Numbers that a file may have for each of its bytes, and that any may have. Measured signals pack
/// to half a byte at best, and 32 MB are no burden.
const NUMBERS_PER_BYTE: usize = 4;
const NUMBERS: usize = 4_000_000;
/// Bytes to which a byte may be unpacked, and to which any file may be: text packs to a tenth, a
/// constant signal to a hundredth.
const UNPACKED_PER_BYTE: usize = 64;
const UNPACKED: usize = 32_000_000;

/// How many numbers are read at most from a file of `length` bytes.
pub(super) fn numbers_max(length: usize) -> usize {
    NUMBERS.max(length.saturating_mul(NUMBERS_PER_BYTE))
}

/// To how many bytes a file of `length` bytes is unpacked at most.
fn unpacked_max(length: usize) -> usize {
    UNPACKED.max(length.saturating_mul(UNPACKED_PER_BYTE))
}

/// Whether crates read the file, whose memory and time only a process of its own can bound.
pub(super) fn is_read_by_crates(bytes: &[u8]) -> bool {
    hdf5_pure::is_hdf5_bytes(bytes) || xlsx::is_zip(bytes) || mcap::is_mcap(bytes)
}

/// The content of the file `name`; `None` if its format is none of these. Of a log the `used`
/// columns are read.
///
/// # Errors
/// The file is damaged.
pub(super) fn read(
    name: &str,
    bytes: &[u8],
    layout: &Layout,
    used: &[&Selector],
) -> Result<Option<Content>, BadInput> {
    if mcap::is_mcap(bytes) {
        return mcap::read(name, bytes, used).map(Some);
    }
    if let Some(sheet) = xlsx::read(name, bytes, layout)? {
        return Ok(Some(sheet));
    }
    let variables = matlab::read(name, bytes)?;
    Ok(variables.map(|(variables, format)| Content::Variables {
        variables,
        format,
        notes: Vec::new(),
    }))
}
