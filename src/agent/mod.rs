//! Agents: a batch goes in, updated networks and figures come out. They never see a simulator.

mod figures;
mod policy;
mod sample;
mod settings;
mod td3;

pub use figures::{Figures, ImaginationFigures};
pub use policy::Policy;
pub use sample::{ImaginationDraws, Sample};
pub use settings::{SmoothingSettings, Td3Settings};
pub use td3::{ImaginaryTargets, Targets, Td3};
