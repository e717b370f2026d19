//! The learned world: a dynamics model, and one step of the task made of it and of what the designer knows.

mod dynamics;
mod settings;
mod world;

pub use dynamics::{DynamicsModel, DynamicsShape, ModelBatch, Prediction};
pub use settings::{ModelSettings, Predict, RewardSource};
pub use world::{Imagined, World};
