//! Networks: multilayer perceptrons, their optimiser, action coupling and observation scaling.
//!
//! A network is plain numbers where it predicts ([`Mlp`]) and a burn module where it is trained
//! ([`TrainableMlp`], held by a [`Learner`]). Everything is single precision, `[batch, features]`.

mod adam;
mod coupling;
mod learner;
mod memory;
mod mlp;
mod scaling;
mod settings;
mod tensors;
mod trainable;
mod weights;

pub use adam::ScalarAdam;
pub use coupling::Coupling;
pub use learner::{Gradient, Learner};
pub use memory::Memory;
pub use mlp::Mlp;
pub use scaling::{ObservationScaling, RunningMoments};
pub use settings::{Backend, NetworkSettings, ScalingSettings};
pub use tensors::{column, matrix, rows_of, side_by_side, to_vec};
pub use trainable::TrainableMlp;
pub use weights::{WeightError, Weights};
