//! Agents: a batch goes in, updated networks and figures come out. They never see a simulator.
//!
//! An agent is a base algorithm (`base`) and an augmentation of its critics' update (`imaginary`, `expansion`).
//! What either does is one file; which ones there are stands in `base` and `augmentation`, and methods are made
//! of them in `config`.

#[allow(clippy::module_inception)]
mod agent;
mod augmentation;
mod base;
mod bootstrap;
mod critics;
mod expansion;
mod figures;
mod imaginary;
mod policy;
mod probe;
mod sample;
mod settings;

pub use agent::{Agent, Targets};
pub use augmentation::Augmentation;
pub use base::EntropyFigures;
pub use expansion::{ExpandedTargets, Position};
pub use figures::{Figures, ImaginationFigures};
pub use imaginary::ImaginaryTargets;
pub use policy::Policy;
pub use probe::Probe;
pub use sample::{ImaginationDraws, ModelDraws, Sample};
pub use settings::{AgentSettings, BaseAlgorithm, SmoothingSettings, TemperatureSettings};
