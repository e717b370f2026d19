//! Model-assisted model-free reinforcement learning on MuJoCo.

pub mod agent;
pub mod cli;
pub mod config;
pub mod core;
pub mod env;
pub mod lab;
pub mod model;
pub mod nn;
pub mod recordings;
pub mod render;
pub mod replay;
pub mod run;
pub mod task;
pub mod training;

/// Activations and gradients of a 256 x 256 layer lie just above the size at which the system
/// allocator maps and unmaps pages on every call; mimalloc keeps them.
#[global_allocator]
static ALLOCATOR: mimalloc::MiMalloc = mimalloc::MiMalloc;
