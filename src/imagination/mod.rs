//! Learning from imaginary transitions (paper, section 4): the dynamics model, what is imagined
//! with it, and which of that is kept. No simulator here.

mod dynamics;
mod filters;
mod noise;
mod settings;
mod transitions;
mod world;

pub use dynamics::{DynamicsModel, DynamicsShape, ModelBatch, Prediction};
pub use filters::{Kept, TargetFilter, UncertaintyFilter, keep};
pub use noise::NoiseBound;
pub use settings::{
    ExpansionSettings, ImaginaryLossMean, ImaginationSettings, ModelSettings, Predict,
    RewardSource, TargetComparison, UncertaintyScale,
};
pub use transitions::{Filters, Imagination};
pub use world::{Imagined, World};
