//! The only room where a simulator and an agent meet: the loop, evaluation, the run directory.

mod checkpoint;
mod curves;
mod error;
mod evaluation;
mod experience;
mod lock;
mod manifest;
mod memory;
mod provenance;
mod run_directory;
mod telemetry;
mod trainer;
mod video;

pub use checkpoint::{Checkpoint, CheckpointError};
pub use curves::{CurveError, EvalRow, last_row, read_evaluations};
pub use error::{DiskError, TrainError};
pub use evaluation::{EpisodeResult, Evaluation, Evaluator, Watch};
pub use lock::LockError;
pub use memory::{NotEnoughMemory, ReplayMemory};
pub use run_directory::{RunDirectory, RunDirectoryError};
pub use trainer::{
    Monitor, Outcome, ResumeOptions, Resumed, Status, Trainer, demonstrations, fresh_agent,
};
pub use video::{Camera, check_video};
