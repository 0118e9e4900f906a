//! The errors that end a run, a replay or a command.

use crate::bench::port::client::LinkError;
use crate::error::BadInput;
use crate::output::NotWritten;

/// The error that ended a run, a replay or a command.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// A file or an option of the user.
    #[error(transparent)]
    Input(#[from] BadInput),
    /// An output.
    #[error(transparent)]
    NotWritten(#[from] NotWritten),
    /// The board or the link to it.
    #[error(transparent)]
    Link(#[from] LinkError),
}
