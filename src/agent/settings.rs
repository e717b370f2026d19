//! Settings of the agents.

use crate::nn::{Coupling, NetworkSettings};
use serde::{Deserialize, Serialize};

/// Target policy smoothing of TD3, in fractions of the action limit.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SmoothingSettings {
    /// Deviation of the normal noise.
    pub deviation: f64,
    /// The noise is clipped to plus and minus this.
    pub clip: f64,
}

/// What TD3 is built from (paper, appendix B).
#[derive(Debug, Clone, PartialEq)]
pub struct Td3Settings {
    /// Networks and learning rates.
    pub networks: NetworkSettings,
    /// Coupling of actions.
    pub coupling: Coupling,
    /// Discount factor.
    pub discount: f64,
    /// Polyak averaging rate.
    pub tau: f64,
    /// Critic updates between two actor and target updates.
    pub policy_delay: u64,
    /// Smoothing of the target policy.
    pub smoothing: SmoothingSettings,
}

impl Td3Settings {
    /// Widths of the actor's layers, input first.
    pub fn actor_widths(&self, obs_size: usize, action_size: usize) -> Vec<usize> {
        let observed = self.coupling.observed_width(obs_size, action_size);
        [&[observed], self.networks.hidden.as_slice(), &[action_size]].concat()
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
