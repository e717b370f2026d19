//! Why a run ends badly.

use super::{CheckpointError, RunDirectoryError};
use crate::env::MakeError;
use crate::replay::DemonstrationError;
use std::path::PathBuf;

/// Why a run ended badly.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum TrainError {
    /// A loss is not finite; the last checkpoint was left as it was.
    #[error(
        "step {step}: {quantity} is not finite; {}",
        good_checkpoint(checkpoint)
    )]
    NotFinite {
        /// The environment step.
        step: u64,
        /// What is not finite.
        quantity: String,
        /// The last good checkpoint.
        checkpoint: Option<PathBuf>,
    },
    /// The task can't be made.
    #[error(transparent)]
    Task(#[from] MakeError),
    /// The demonstrations can't be used.
    #[error("demonstrations.path: {error}")]
    Demonstrations {
        /// What is wrong with them; part of the message, and hence no source of it.
        error: DemonstrationError,
    },
    /// A file of the run directory can't be written.
    #[error(transparent)]
    RunDirectory(#[from] RunDirectoryError),
    /// A checkpoint can't be saved.
    #[error(transparent)]
    Checkpoint(#[from] CheckpointError),
    /// The threads can't be started.
    #[error("can't start {threads} threads: {error}")]
    Threads {
        /// The number asked for.
        threads: usize,
        /// What the system said.
        error: rayon::ThreadPoolBuildError,
    },
    /// A curve can't be written.
    #[error("{}: can't write the learning curves: {error}", path.display())]
    Curves {
        /// The run directory.
        path: PathBuf,
        /// What went wrong.
        error: csv::Error,
    },
}

fn good_checkpoint(checkpoint: &Option<PathBuf>) -> String {
    match checkpoint {
        Some(path) => format!("the last good checkpoint is {}", path.display()),
        None => "no checkpoint had been saved yet".to_owned(),
    }
}

impl From<DemonstrationError> for TrainError {
    fn from(error: DemonstrationError) -> TrainError {
        TrainError::Demonstrations { error }
    }
}
