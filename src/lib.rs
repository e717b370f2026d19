//! Model-assisted model-free reinforcement learning on MuJoCo.

pub mod env;
pub mod random;
pub mod verification;

/// Activations and gradients of a 256 x 256 layer lie just above the size at which the system
/// allocator maps and unmaps pages on every call; mimalloc keeps them.
#[global_allocator]
static ALLOCATOR: mimalloc::MiMalloc = mimalloc::MiMalloc;
