//! Reading of files, up to a size: a device that never ends is no input.

use crate::error::BadInput;
use std::fs::File;
use std::io::Read;
use std::path::Path;

/// The largest file of measurements: some ten million rows.
const BYTES_MAX: u64 = 500_000_000;
/// The largest file that a person writes: rig, mapping, settings.
const TEXT_BYTES_MAX: u64 = 10_000_000;

/// The bytes of the file at `path`, which is `expected`: «a readable CSV file».
///
/// # Errors
/// The file cannot be read, or has more than 500 MB.
pub fn read(path: &Path, expected: &str) -> Result<Vec<u8>, BadInput> {
    read_up_to(BYTES_MAX, path, expected)
}

/// The text of the file at `path`, as [`read`].
///
/// # Errors
/// The file cannot be read, has more than 10 MB, or is not UTF-8.
pub fn read_text(path: &Path, expected: &str) -> Result<String, BadInput> {
    let bytes = read_up_to(TEXT_BYTES_MAX, path, expected)?;
    String::from_utf8(bytes).map_err(|error| {
        let before = &error.as_bytes()[..error.utf8_error().valid_up_to()];
        BadInput {
            line: Some(1 + before.iter().filter(|byte| **byte == b'\n').count()),
            ..BadInput::file(
                path.display().to_string(),
                "text in UTF-8, found other bytes (`iconv -f LATIN1 -t UTF-8` converts Latin-1)",
            )
        }
    })
}

fn read_up_to(bytes_max: u64, path: &Path, expected: &str) -> Result<Vec<u8>, BadInput> {
    let bad = |expected: String| BadInput::file(path.display().to_string(), expected);
    let unreadable = |error: std::io::Error| bad(format!("{expected}, {error}"));
    let file = File::open(path).map_err(unreadable)?;
    let found = file.metadata().map_err(unreadable)?;
    if found.is_dir() {
        return Err(bad(format!("{expected}, found a folder")));
    }
    let size = found.len();
    let mut bytes = Vec::with_capacity(size.min(bytes_max) as usize);
    let mut limited = file.take(bytes_max + 1);
    limited.read_to_end(&mut bytes).map_err(unreadable)?;
    if bytes.len() as u64 > bytes_max {
        let most = bytes_max / 1_000_000;
        return Err(bad(format!("{expected} of at most {most} MB, found more")));
    }
    Ok(bytes)
}
