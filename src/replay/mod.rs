//! Transitions: stored, and sampled into batches. No networks, no simulator.

mod batch;
mod buffer;
mod sampler;

pub use batch::Batch;
pub use buffer::{ReplayBuffer, Transition};
pub use sampler::{Chosen, Sampler, Uniform};
