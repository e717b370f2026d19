//! A run on disk: its directory, lock, curves, checkpoints and where it came from. No simulator, no agent.

pub(crate) mod checkpoint;
mod curves;
mod directory;
mod error;
mod lock;
pub(crate) mod manifest;
pub mod memory;
pub(crate) mod provenance;
mod replay_log;
pub mod schema;

pub use checkpoint::{Checkpoint, CheckpointError};
pub use curves::{CurveError, Curves, EvalRow, TimingRow, last_row, read_evaluations};
pub use directory::{RunDirectory, RunDirectoryError};
pub use error::DiskError;
pub use lock::LockError;
pub use memory::{NotEnoughMemory, ReplayMemory};
pub use replay_log::{Chunk, Logged, ReplayLog, ReplayLogError};
