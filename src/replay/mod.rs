//! Transitions: stored, and sampled into batches. No networks, no simulator.

mod batch;
mod buffer;

pub use batch::Batch;
pub use buffer::{ReplayBuffer, Transition};
