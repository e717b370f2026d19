//! Agents: a batch goes in, updated networks and figures come out. They never see a simulator.
//!
//! An agent is a [core](self::core), actor and critics, and what [augments](augment) its critics' update. One update
//! of TD3 reads from top to bottom in `core/mod.rs` and `core/deterministic.rs`; each other actor, and each augmentation,
//! is one file.
//! Methods are made of them in `config`.

#[allow(clippy::module_inception)]
mod agent;
pub mod augment;
mod controller;
pub mod core;
mod metrics;
mod recorded;
mod sample;
mod settings;

pub use self::core::{ActorCritic, CriticRows, Values};
pub use agent::{Agent, Targets, Update, targets};
pub use controller::{Controller, Exploring, Moment, Playing, Policy, RandomActions, Zero};
pub use metrics::Metrics;
pub use recorded::Recorded;
pub use sample::Sample;
pub use settings::{
    AgentSettings, BaseAlgorithm, Imitation, SmoothingSettings, TargetRule, TargetValue,
    TemperatureSettings,
};
