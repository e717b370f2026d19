//! Settings of networks and observation scaling, and the device they run on.

use super::Normalisation;
use burn::tensor::Device;
use serde::{Deserialize, Serialize};

/// Actor and critics.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct NetworkSettings {
    /// Run or checkpoint whose networks are begun with; empty for fresh ones.
    pub from: String,
    /// Widths of the hidden layers of actor and critics.
    pub hidden: Vec<usize>,
    /// Adam's learning rate of the actor.
    pub actor_learning_rate: f64,
    /// Adam's learning rate of the critics.
    pub critic_learning_rate: f64,
    /// What is done to the critics' hidden layers before the activation.
    pub critic_normalisation: Normalisation,
    /// Weight of the mean square of what the actor's last layer gives before it is squashed, beside
    /// `-mean Q1 / mean |Q1|`.
    pub saturation_penalty: f64,
}

/// Standardisation of observations by running mean and deviation.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ScalingSettings {
    /// Off leaves observations as they are.
    pub enabled: bool,
    /// Environment steps between two recomputations.
    pub every: u64,
    /// Scaled observations are clipped to plus and minus this.
    pub clip: f64,
    /// Smallest deviation divided by.
    pub deviation_floor: f64,
}

/// Tensor library behind the networks.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Backend {
    /// burn's own CPU library, the faster one here.
    Flex,
    /// burn on `ndarray`.
    Ndarray,
}

impl Backend {
    /// The plain device of this library; see [`Device::autodiff`] for the one to train on.
    pub fn device(self) -> Device {
        match self {
            Backend::Flex => Device::flex(),
            // burn calls it deprecated; it stays selectable for comparison.
            #[allow(deprecated)]
            Backend::Ndarray => Device::ndarray(),
        }
    }
}
