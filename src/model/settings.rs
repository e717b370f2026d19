//! Settings of the dynamics model.

use serde::{Deserialize, Serialize};

/// What the dynamics model predicts, in scaled space.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Predict {
    /// The next observation itself (paper, equation 5).
    NextState,
    /// The change of the observation.
    Delta,
}

/// Where the rewards of imagined steps come from.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum RewardSource {
    /// The designer's rule (paper).
    Known,
    /// A further output of the dynamics model, for tasks whose reward nobody can write down.
    Learned,
}

/// The learned dynamics model.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ModelSettings {
    /// Widths of its hidden layers.
    pub hidden: Vec<usize>,
    /// Adam's learning rate.
    pub learning_rate: f64,
    /// What it predicts.
    pub predict: Predict,
}
