//! The methods, as points of one small space.

use crate::agent::BaseAlgorithm;
use serde::{Deserialize, Serialize};

/// A named point of the space *base algorithm x augmentation of the critic update x critic updates a
/// step*; its preset says the rest.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Method {
    /// TD3 with imaginary transitions: the paper's method.
    Mamf,
    /// SAC with imaginary transitions (paper, appendix C).
    MamfSac,
    /// Plain TD3 (Fujimoto et al. 2018), the baseline.
    Td3,
    /// TD3 with two critic updates a step (paper, appendix C).
    #[serde(rename = "td3-critic2")]
    Td3Critic2,
    /// TD3 with model-based value expansion (Feinberg et al. 2018).
    MveTd3,
    /// TD3 with imaginary transitions filtered by uncertainty only, after MA-BDDPG (Kalweit and
    /// Boedecker 2017).
    MaTd3,
    /// DDPG (Lillicrap et al. 2016).
    Ddpg,
    /// SAC with a learned temperature (Haarnoja et al. 2018).
    Sac,
}

/// What is added to the base algorithm's critic update.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Addition {
    /// Nothing.
    None,
    /// Imaginary one-step transitions with noisy actions, filtered (paper, section 4).
    Imagination,
    /// Targets over imagined steps.
    Expansion,
}

impl Method {
    /// All methods, the paper's first.
    pub const ALL: [Method; 8] = [
        Method::Mamf,
        Method::MamfSac,
        Method::Td3,
        Method::Td3Critic2,
        Method::MveTd3,
        Method::MaTd3,
        Method::Ddpg,
        Method::Sac,
    ];

    /// The name used in configurations and run directories.
    pub fn name(self) -> &'static str {
        match self {
            Method::Mamf => "mamf",
            Method::MamfSac => "mamf-sac",
            Method::Td3 => "td3",
            Method::Td3Critic2 => "td3-critic2",
            Method::MveTd3 => "mve-td3",
            Method::MaTd3 => "ma-td3",
            Method::Ddpg => "ddpg",
            Method::Sac => "sac",
        }
    }

    /// What the method builds on.
    pub fn base(self) -> BaseAlgorithm {
        match self {
            Method::Mamf | Method::Td3 | Method::Td3Critic2 | Method::MveTd3 | Method::MaTd3 => {
                BaseAlgorithm::Td3
            }
            Method::Ddpg => BaseAlgorithm::Ddpg,
            Method::MamfSac | Method::Sac => BaseAlgorithm::Sac,
        }
    }

    /// What the method adds to its base.
    pub fn addition(self) -> Addition {
        match self {
            Method::Mamf | Method::MamfSac | Method::MaTd3 => Addition::Imagination,
            Method::MveTd3 => Addition::Expansion,
            Method::Td3 | Method::Td3Critic2 | Method::Ddpg | Method::Sac => Addition::None,
        }
    }

    /// Whether the method trains a dynamics model.
    pub fn learns_model(self) -> bool {
        self.addition() != Addition::None
    }

    /// Why the setting `key` means nothing to the method, if it does not.
    ///
    /// Settings of the dynamics model (`model`, `model_start`, `rules`) are not among them: runs with and
    /// without one are started with the same options, to be compared.
    pub fn ignores(self, key: &str) -> Option<&'static str> {
        let section = key.split('.').next().unwrap_or(key);
        let (base, addition) = (self.base(), self.addition());
        match section {
            "imagination" if addition != Addition::Imagination => Some("imagines no other actions"),
            "expansion" if addition != Addition::Expansion => Some("expands no values"),
            "temperature" if base != BaseAlgorithm::Sac => Some("has no temperature"),
            "target_smoothing" if base != BaseAlgorithm::Td3 => {
                Some("does not smooth the target policy")
            }
            "exploration_noise" if base == BaseAlgorithm::Sac => {
                Some("explores by its policy's own noise")
            }
            _ => None,
        }
    }
}
