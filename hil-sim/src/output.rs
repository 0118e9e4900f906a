//! Files that appear whole or not at all.

use std::io::Write;
use std::path::Path;

/// A file that could not be written.
#[derive(Debug, thiserror::Error)]
#[error("{path}: cannot be written: {source}")]
pub struct NotWritten {
    /// The file.
    pub path: String,
    /// Why.
    pub source: std::io::Error,
}

/// Writes `bytes` to `path` through a temporary file beside it, which then takes its place.
///
/// # Errors
/// The folder does not exist or cannot be written; then nothing has changed.
pub fn write_atomically(path: &Path, bytes: &[u8]) -> Result<(), NotWritten> {
    let write = || {
        let folder = match path.parent() {
            Some(folder) if !folder.as_os_str().is_empty() => folder,
            _ => Path::new("."),
        };
        let mut builder = tempfile::Builder::new();
        #[cfg(unix)]
        {
            // A report is for reading by others too: what `open` would give, not the 600 of a
            // temporary file.
            use std::os::unix::fs::PermissionsExt;
            builder.permissions(std::fs::Permissions::from_mode(0o666));
        }
        let mut file = builder.tempfile_in(folder)?;
        file.write_all(bytes)?;
        file.as_file().sync_all()?;
        file.persist(path).map_err(|error| error.error)?;
        Ok(())
    };
    write().map_err(|source| NotWritten {
        path: path.display().to_string(),
        source,
    })
}
