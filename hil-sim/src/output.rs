//! Atomic writing of files, and the time that they say.

use crate::error::BadInput;
use std::io::Write;
use std::path::Path;
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::{Duration, SystemTime, UNIX_EPOCH};
use toml_edit::{Date, Datetime, Offset, Time};

/// Environment variable with the time that written files say, in seconds since 1970: with it two
/// runs write the same bytes (reproducible-builds.org/specs/source-date-epoch).
const SOURCE_DATE_EPOCH: &str = "SOURCE_DATE_EPOCH";

/// The time since 1970, UTC, that written files say: now, or that in `SOURCE_DATE_EPOCH`.
///
/// # Errors
/// The variable is no number of seconds.
pub fn written_at() -> Result<Duration, BadInput> {
    let Some(text) = std::env::var_os(SOURCE_DATE_EPOCH) else {
        return Ok(SystemTime::now()
            .duration_since(UNIX_EPOCH)
            .unwrap_or_default());
    };
    // To the year 9999.
    let seconds = text.to_str().and_then(|text| text.parse().ok());
    let seconds = seconds.filter(|seconds| *seconds < 253_402_300_800);
    seconds.map(Duration::from_secs).ok_or_else(|| {
        let found = text.to_string_lossy();
        let expected = format!("whole seconds since 1970, found \"{found}\"");
        BadInput::file(
            format!("environment variable {SOURCE_DATE_EPOCH}"),
            expected,
        )
    })
}

/// A time since 1970 as date and time of day, UTC, in whole seconds.
pub fn utc(since_1970: Duration) -> Datetime {
    let seconds = since_1970.as_secs();
    let (day, second) = (seconds / 86_400, (seconds % 86_400) as u32);
    // Days from 1 March of the year 0, in whose cycle of 400 years leap days are last
    // (H. Hinnant, chrono-compatible low-level date algorithms).
    let from_march = day + 719_468;
    let (cycle, of_cycle) = (from_march / 146_097, from_march % 146_097);
    let year = (of_cycle - of_cycle / 1460 + of_cycle / 36_524 - of_cycle / 146_096) / 365;
    let of_year = of_cycle - (365 * year + year / 4 - year / 100);
    let month = (5 * of_year + 2) / 153;
    let (month_from_1, year_later) = if month < 10 {
        (month + 3, 0)
    } else {
        (month - 9, 1)
    };
    Datetime {
        date: Some(Date {
            year: (year + 400 * cycle + year_later) as u16,
            month: month_from_1 as u8,
            day: (of_year - (153 * month + 2) / 5 + 1) as u8,
        }),
        time: Some(Time {
            hour: (second / 3600) as u8,
            minute: (second / 60 % 60) as u8,
            second: Some((second % 60) as u8),
            nanosecond: None,
        }),
        offset: Some(Offset::Z),
    }
}

/// Held while a temporary file exists.
static WRITING: Mutex<()> = Mutex::new(());

/// Waits until no file is being written; none is begun while the result is held.
pub fn complete_writing() -> MutexGuard<'static, ()> {
    WRITING.lock().unwrap_or_else(PoisonError::into_inner)
}

/// A file that could not be written.
#[derive(Debug, thiserror::Error)]
#[error("{path}: cannot be written: {source}")]
pub struct NotWritten {
    /// The file.
    pub path: String,
    /// Why.
    pub source: std::io::Error,
}

impl NotWritten {
    /// `path` cannot be written.
    pub fn new(path: impl AsRef<Path>, source: std::io::Error) -> NotWritten {
        NotWritten {
            path: path.as_ref().display().to_string(),
            source,
        }
    }
}

/// Writes `bytes` to `path` through a temporary file beside it, which then takes its place. What is
/// no file (a pipe, a device) is written to; a link stays, and the file it names is replaced.
///
/// # Errors
/// The folder does not exist or cannot be written, a link leads nowhere; then nothing has changed.
pub fn write_atomically(path: &Path, bytes: &[u8]) -> Result<(), NotWritten> {
    write_atomically_with(path, |out| out.write_all(bytes))
}

/// As [`write_atomically`], of what `content` writes.
///
/// # Errors
/// As [`write_atomically`], or `content` fails.
pub(crate) fn write_atomically_with(
    path: &Path,
    content: impl Fn(&mut dyn Write) -> std::io::Result<()>,
) -> Result<(), NotWritten> {
    let write = || {
        if is_stream(path) {
            let mut stream = std::fs::OpenOptions::new().write(true).open(path)?;
            return content(&mut stream);
        }
        let path = &if path.is_symlink() {
            path.canonicalize()?
        } else {
            path.to_path_buf()
        };
        let folder = match path.parent() {
            Some(folder) if !folder.as_os_str().is_empty() => folder,
            _ => Path::new("."),
        };
        if !folder.is_dir() {
            let what = format!("there is no folder {}", folder.display());
            return Err(std::io::Error::new(std::io::ErrorKind::NotFound, what));
        }
        let _writing = complete_writing();
        let mut builder = tempfile::Builder::new();
        #[cfg(unix)]
        {
            // A report is for reading by others too: what `open` would give, not the 600 of a
            // temporary file.
            use std::os::unix::fs::PermissionsExt;
            builder.permissions(std::fs::Permissions::from_mode(0o666));
        }
        // Its error names a file that nobody knows.
        let file = builder.tempfile_in(folder);
        let mut file = file.map_err(|error| std::io::Error::from(error.kind()))?;
        content(&mut file)?;
        file.as_file().sync_all()?;
        file.persist(path).map_err(|error| error.error)?;
        Ok(())
    };
    write().map_err(|source| NotWritten::new(path, source))
}

/// Whether `path` exists and is neither a file nor a folder.
fn is_stream(path: &Path) -> bool {
    std::fs::metadata(path).is_ok_and(|found| !found.is_file() && !found.is_dir())
}

/// Whether two paths name the same file, also if it does not exist.
pub fn same_file(one: &Path, other: &Path) -> bool {
    let whole = |path: &Path| {
        let folder = match path.parent() {
            Some(folder) if !folder.as_os_str().is_empty() => folder,
            _ => Path::new("."),
        };
        let named = || Some(folder.canonicalize().ok()?.join(path.file_name()?));
        path.canonicalize().ok().or_else(named)
    };
    !is_stream(one) && whole(one).is_some_and(|one| Some(one) == whole(other))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// As `date --utc --date @SECONDS` prints them: leap years, also of centuries, and ends of
    /// months.
    #[test]
    fn seconds_since_1970_become_a_date() {
        for (seconds, date) in [
            (0, "1970-01-01T00:00:00Z"),
            (951_782_399, "2000-02-28T23:59:59Z"),
            (951_782_400, "2000-02-29T00:00:00Z"),
            (1_709_251_199, "2024-02-29T23:59:59Z"),
            (1_709_251_200, "2024-03-01T00:00:00Z"),
            (4_107_542_400, "2100-03-01T00:00:00Z"),
            (1_798_761_599, "2026-12-31T23:59:59Z"),
        ] {
            assert_eq!(utc(Duration::from_secs(seconds)).to_string(), date);
        }
    }
}
