//! Settings of the agents.

use crate::nn::{Coupling, NetworkSettings};
use serde::{Deserialize, Serialize};

/// The algorithm that a method builds on.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum BaseAlgorithm {
    /// Deep deterministic policy gradient (Lillicrap et al. 2016): one critic, no smoothing.
    Ddpg,
    /// Twin delayed DDPG (Fujimoto et al. 2018).
    Td3,
    /// Soft actor-critic with a learned temperature (Haarnoja et al. 2018).
    Sac,
}

impl BaseAlgorithm {
    /// Critics, and target critics.
    pub fn critics(self) -> usize {
        match self {
            BaseAlgorithm::Ddpg => 1,
            BaseAlgorithm::Td3 | BaseAlgorithm::Sac => 2,
        }
    }

    /// Whether the policy is a distribution.
    pub fn is_stochastic(self) -> bool {
        self == BaseAlgorithm::Sac
    }
}

/// Target policy smoothing of TD3, in fractions of the action limit.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SmoothingSettings {
    /// Deviation of the normal noise.
    pub deviation: f64,
    /// The noise is clipped to plus and minus this.
    pub clip: f64,
}

/// Temperature of SAC: the weight of the policy's entropy.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TemperatureSettings {
    /// The temperature at first.
    pub initial: f64,
    /// Adam's learning rate, on its logarithm.
    pub learning_rate: f64,
}

/// What an agent is built from (paper, appendix B).
#[derive(Debug, Clone, PartialEq)]
pub struct AgentSettings {
    /// The base algorithm.
    pub base: BaseAlgorithm,
    /// Networks and learning rates.
    pub networks: NetworkSettings,
    /// Coupling of actions.
    pub coupling: Coupling,
    /// Discount factor.
    pub discount: f64,
    /// Polyak averaging rate.
    pub tau: f64,
    /// Updates between two actor and target updates.
    pub policy_delay: u64,
    /// Smoothing of the target policy, of TD3.
    pub smoothing: SmoothingSettings,
    /// Temperature, of SAC.
    pub temperature: TemperatureSettings,
}

impl AgentSettings {
    /// Widths of the actor's layers, input first.
    pub fn actor_widths(&self, obs_size: usize, action_size: usize) -> Vec<usize> {
        let observed = self.coupling.observed_width(obs_size, action_size);
        // Mean and log-deviation of each number, or the number itself.
        let outputs = action_size * if self.base.is_stochastic() { 2 } else { 1 };
        [&[observed], self.networks.hidden.as_slice(), &[outputs]].concat()
    }

    /// Widths of a critic's layers, input first.
    pub fn critic_widths(&self, obs_size: usize, action_size: usize) -> Vec<usize> {
        let observed = self.coupling.observed_width(obs_size, action_size);
        [
            &[observed + action_size],
            self.networks.hidden.as_slice(),
            &[1],
        ]
        .concat()
    }
}
