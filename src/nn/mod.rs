//! Networks: multilayer perceptrons, their optimiser, action coupling and observation scaling.
//!
//! A network is plain numbers where it predicts ([`Mlp`]) and a burn module where it is trained
//! ([`TrainableMlp`], held by a [`TrainableNetwork`]). Everything is single precision, `[batch, features]`.

mod activation;
mod adam;
mod coupling;
mod learning_state;
mod mlp;
mod scaling;
mod settings;
mod tensors;
mod trainable;
mod trainable_network;
mod weights;

pub use activation::{Activation, Normalisation};
pub use adam::ScalarAdam;
pub use coupling::{Coupling, Range};
pub use learning_state::LearningState;
pub use mlp::{Architecture, Mlp};
pub use scaling::{ObservationScaling, RunningMoments};
pub use settings::{Backend, NetworkSettings, ScalingSettings};
pub use tensors::{column, matrix, rows_of, side_by_side, to_vec};
pub use trainable::TrainableMlp;
pub use trainable_network::{Gradient, TrainableNetwork};
pub use weights::{WeightError, Weights};
