//! What keeps a recording from being read.

use std::path::{Path, PathBuf};

/// What keeps a recording from being read.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum RecordingError {
    /// A file cannot be opened or read.
    #[error("{}: cannot be read: {source}", path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// What the system says.
        source: std::io::Error,
    },
    /// One of the two files of a recording is not there.
    #[error("{}: is missing; a recording is an .npz file and the .json file of the same name", path.display())]
    Missing {
        /// The file.
        path: PathBuf,
    },
    /// The settings are not what they should be.
    #[error("{}: not the settings of a recording: {source}", path.display())]
    Settings {
        /// The file.
        path: PathBuf,
        /// What is wrong.
        source: serde_json::Error,
    },
    /// The archive cannot be read.
    #[error("{}: not a readable archive of arrays: {source}", path.display())]
    Archive {
        /// The file.
        path: PathBuf,
        /// What is wrong.
        source: std::io::Error,
    },
    /// An array is missing or is not what it should be.
    #[error("{}: array `{array}`: {problem}", path.display())]
    Array {
        /// The file.
        path: PathBuf,
        /// The array.
        array: String,
        /// What is wrong.
        problem: String,
    },
}

impl RecordingError {
    /// The file `path` could not be read.
    pub(super) fn io(path: &Path, source: std::io::Error) -> RecordingError {
        let path = path.to_owned();
        match source.kind() {
            std::io::ErrorKind::NotFound => RecordingError::Missing { path },
            _ => RecordingError::Io { path, source },
        }
    }

    /// Something is wrong with an array of the file `path`.
    pub(super) fn array(path: &Path, array: &str, problem: impl Into<String>) -> RecordingError {
        RecordingError::Array {
            path: path.to_owned(),
            array: array.to_owned(),
            problem: problem.into(),
        }
    }
}
