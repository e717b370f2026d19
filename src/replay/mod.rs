//! Transitions: stored, and sampled into batches; and the demonstrations that experience begins
//! from. No networks, no simulator.

mod batch;
mod buffer;
mod demonstrations;
mod log;
mod segments;

pub use batch::Batch;
pub use buffer::{ReplayBuffer, Transition};
pub use demonstrations::{DemonstrationError, DemonstrationState, Demonstrations, Sizes, dense};
pub use log::{Chunk, Logged, ReplayLog, ReplayLogError};
pub use segments::{DemonstrationSettings, SegmentStart, Segments};
