//! Networks: multilayer perceptrons, actor, critic, their optimiser, and observation scaling.
//!
//! Tensors are `[batch, features]`, single precision. Networks under training live on a device
//! with automatic differentiation, targets and acting copies on the plain one.

mod actor;
mod adam;
mod critic;
mod learner;
mod mlp;
mod scaling;
mod settings;
mod tensors;
mod weights;

pub use actor::{Actor, Coupling};
pub use adam::Adam;
pub use critic::Critic;
pub use learner::Learner;
pub use mlp::Mlp;
pub use scaling::{ObservationScaling, RunningMoments};
pub use settings::{Backend, NetworkSettings, ScalingSettings};
pub use tensors::{column, matrix, rows_of, side_by_side, to_vec};
pub use weights::{WeightError, Weights};
