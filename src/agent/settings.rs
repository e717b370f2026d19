//! Settings of the agents.

use crate::nn::{Architecture, Coupling, NetworkSettings, Normalisation};
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

/// Target policy smoothing of TD3, in fractions of half of each action number's range.
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

/// How target networks follow the networks that are trained.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum TargetRule {
    /// With each step of the actor, the fraction `tau` of the way (Polyak averaging).
    Polyak {
        /// In (0, 1].
        tau: f64,
    },
    /// Made equal every so many updates.
    HardCopy {
        /// Updates between two copies, at least 1.
        every: u64,
    },
}

impl TargetRule {
    /// The fraction of the way that targets move after `updates` updates, if they do.
    pub fn due(self, updates: u64, policy_delay: u64) -> Option<f64> {
        match self {
            TargetRule::Polyak { tau } => updates.is_multiple_of(policy_delay).then_some(tau),
            TargetRule::HardCopy { every } => updates.is_multiple_of(every).then_some(1.0),
        }
    }
}

/// How the actor imitates recorded actions, beside climbing the critic.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Imitation {
    /// Weight of the mean squared error of the actions in the recorded rows, beside `-mean Q1 / mean |Q1|` (Fujimoto
    /// and Gu 2021, equation 3, whose weight is 0.4). 0 for none.
    pub weight: f64,
    /// Whether it counts only where `Q1` prefers the recorded action (Nair et al. 2018, equation 5).
    pub filter: bool,
}

/// What becomes of the values of both target critics in a target.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum TargetValue {
    /// The smaller one (Fujimoto et al. 2018).
    Minimum,
    /// Their mean.
    Mean,
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
    /// How target networks follow.
    pub targets: TargetRule,
    /// Updates between two actor and target updates.
    pub policy_delay: u64,
    /// Smoothing of the target policy, of TD3.
    pub smoothing: SmoothingSettings,
    /// Temperature, of SAC.
    pub temperature: TemperatureSettings,
    /// What becomes of the values of both target critics.
    pub target_value: TargetValue,
    /// Imitation of recorded actions, of deterministic actors.
    pub imitation: Imitation,
}

impl AgentSettings {
    /// The actor's network: what is observed to one number an action number, or its mean and log-deviation.
    pub fn actor(&self, obs_size: usize, action_size: usize) -> Architecture {
        let observed = self.coupling.observed_width(obs_size, action_size);
        let outputs = action_size * if self.base.is_stochastic() { 2 } else { 1 };
        self.perceptron(observed, outputs, Normalisation::None)
    }

    /// A critic's network: what is observed and the executed action to a value.
    pub fn critic(&self, obs_size: usize, action_size: usize) -> Architecture {
        let observed = self.coupling.observed_width(obs_size, action_size);
        self.perceptron(
            observed + action_size,
            1,
            self.networks.critic_normalisation,
        )
    }

    fn perceptron(
        &self,
        inputs: usize,
        outputs: usize,
        normalisation: Normalisation,
    ) -> Architecture {
        let hidden = self.networks.hidden.as_slice();
        Architecture {
            normalisation,
            ..Architecture::relu(&[&[inputs], hidden, &[outputs]].concat())
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn targets_follow_with_the_actor_or_are_copied_every_so_often() {
        let due =
            |rule: TargetRule| -> Vec<Option<f64>> { (1..=6).map(|n| rule.due(n, 2)).collect() };
        let (tau, all) = (Some(0.005), Some(1.0));
        let polyak = due(TargetRule::Polyak { tau: 0.005 });
        assert_eq!(polyak, [None, tau, None, tau, None, tau]);
        let copied = due(TargetRule::HardCopy { every: 3 });
        assert_eq!(copied, [None, None, all, None, None, all]);
    }
}
