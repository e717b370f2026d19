//! Why a run ends badly.

use crate::config::ConfigError;
use crate::core::files::FileError;
use crate::env::MakeError;
use crate::recordings::DemonstrationError;
use crate::recordings::format::WriteError;
use crate::run::{CheckpointError, DiskError, NotEnoughMemory, ReplayMemory, RunDirectoryError};
use std::collections::TryReserveError;
use std::io::ErrorKind;
use std::path::PathBuf;

/// Why a run ended badly.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum TrainError {
    /// A number is not finite; the last checkpoint was left as it was.
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
    /// The configuration of a run can't be used.
    #[error(transparent)]
    Config(#[from] ConfigError),
    /// The task can't be made.
    #[error(transparent)]
    Task(#[from] MakeError),
    /// The demonstrations can't be used.
    #[error("demonstrations.path: {error}{}", relative_to(base))]
    Demonstrations {
        /// What is wrong with them; part of the message, and hence no source of it.
        error: DemonstrationError,
        /// The working directory, where they were not found and their path is relative to it.
        base: Option<PathBuf>,
    },
    /// A run can't begin with the networks that it asks for.
    #[error("networks.from = {path:?}: {reason}")]
    Networks {
        /// The run or checkpoint.
        path: String,
        /// Why not.
        reason: String,
    },
    /// An episode that the planner made can't be recorded.
    #[error("{}: {error}", stem.display())]
    Planned {
        /// Its files, without their endings.
        stem: PathBuf,
        /// Why not; part of the message, and hence no source of it.
        error: WriteError,
    },
    /// A file of the run directory can't be written.
    #[error(transparent)]
    RunDirectory(#[from] RunDirectoryError),
    /// A checkpoint can't be read.
    #[error(transparent)]
    Checkpoint(#[from] CheckpointError),
    /// The system refused before training began.
    #[error(transparent)]
    File(#[from] FileError),
    /// A disk refused, perhaps because it is full.
    #[error("{error}; {}", good_checkpoint(checkpoint))]
    Disk {
        /// What was refused; part of the message, and hence no source of it.
        error: DiskError,
        /// The last good checkpoint.
        checkpoint: Option<PathBuf>,
    },
    /// The replay buffer would not fit.
    #[error(transparent)]
    Memory(#[from] NotEnoughMemory),
    /// The system does not give the memory of the replay buffer.
    #[error(
        "replay buffer, {memory}: the system does not give that much ({error}); lower replay.capacity"
    )]
    Replay {
        /// What it takes.
        memory: ReplayMemory,
        /// What the system said.
        error: TryReserveError,
    },
    /// A run can't go on as it was.
    #[error(
        "{}: something has changed since the checkpoint:\n  {}\n{}",
        path.display(),
        differences.join("\n  "),
        if *harmless {
            "this need not change results; --force goes on all the same (in a sweep --accept-program)"
        } else {
            "undo this, or train anew with --out: --force does not help"
        }
    )]
    Changed {
        /// The run directory.
        path: PathBuf,
        /// Each difference in words.
        differences: Vec<String>,
        /// Whether going on can be forced.
        harmless: bool,
    },
    /// A run that had saved checkpoints has none.
    #[error(
        "{}: the curves go to step {reached}, but there is no checkpoint, although one was due at step {due}; \
         bring checkpoints/last back, or train anew with --out",
        path.display()
    )]
    CheckpointsMissing {
        /// The run directory.
        path: PathBuf,
        /// Step of the last evaluation.
        reached: u64,
        /// Step of the first checkpoint.
        due: u64,
    },
    /// The demonstrations are not those that a run was saved with.
    #[error(
        "demonstrations.path = {0:?}: these are not the demonstrations that the run began with"
    )]
    OtherDemonstrations(String),
    /// A run was not saved to go on from.
    #[error(
        "{}: the run was made with checkpoint.replay = false: it can be evaluated, but not resumed",
        .0.display()
    )]
    NotResumable(PathBuf),
    /// A run is asked to end before where it is.
    #[error(
        "steps = {asked}: the run has taken {taken} steps already; at least {taken} would be right"
    )]
    StepsTaken {
        /// Steps that the checkpoint is after.
        taken: u64,
        /// Steps asked for.
        asked: u64,
    },
    /// No checkpoint of a run is whole.
    #[error("no checkpoint of the run is whole: {last}; and of the one before it, {previous}")]
    NoGoodCheckpoint {
        /// What is wrong with the last one.
        last: Box<TrainError>,
        /// What is wrong with the one before.
        previous: Box<TrainError>,
    },
    /// The threads can't be started.
    #[error(
        "compute.threads: {threads} threads can't be started here ({error}); --threads 1 needs fewest"
    )]
    Threads {
        /// The number asked for.
        threads: usize,
        /// What the system said.
        error: rayon::ThreadPoolBuildError,
    },
}

impl TrainError {
    /// Whether a checkpoint is damaged or lacks a file, so that an older one may serve. What the system refuses to
    /// read may be readable another time.
    pub(super) fn is_damage(&self) -> bool {
        use CheckpointError::{Damaged, File, Missing};
        match self {
            TrainError::Checkpoint(Damaged { .. } | Missing(_)) => true,
            TrainError::Checkpoint(File(error)) => error.error.kind() == ErrorKind::NotFound,
            _ => false,
        }
    }
}

fn relative_to(base: &Option<PathBuf>) -> String {
    match base {
        Some(base) => format!(
            "; the path is relative to the working directory, {}, also when a run goes on",
            base.display()
        ),
        None => String::new(),
    }
}

fn good_checkpoint(checkpoint: &Option<PathBuf>) -> String {
    match checkpoint {
        Some(path) => format!("the last good checkpoint is {}", path.display()),
        None => "no checkpoint had been saved yet".to_owned(),
    }
}
