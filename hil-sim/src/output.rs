//! Atomic writing of files.

use std::io::Write;
use std::path::Path;
use std::sync::{Mutex, MutexGuard, PoisonError};

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
        let _writing = complete_writing();
        let mut builder = tempfile::Builder::new();
        #[cfg(unix)]
        {
            // A report is for reading by others too: what `open` would give, not the 600 of a
            // temporary file.
            use std::os::unix::fs::PermissionsExt;
            builder.permissions(std::fs::Permissions::from_mode(0o666));
        }
        let mut file = builder.tempfile_in(folder)?;
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
