//! What a disk refuses while a run is written.

use crate::core::files::FileError;
use std::path::PathBuf;

/// What a disk refused.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum DiskError {
    /// A file or directory.
    #[error(transparent)]
    File(#[from] FileError),
    /// A row of a curve that has no form as a line.
    #[error("{}: {error}", path.display())]
    Row {
        /// The file.
        path: PathBuf,
        /// What is wrong.
        error: csv::Error,
    },
}
