//! The methods, as points of one small space.

use serde::{Deserialize, Serialize};

/// A named point of the space *base algorithm x augmentation of the critic update*.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Method {
    /// TD3 with imaginary transitions: the paper's method.
    Mamf,
    /// Plain TD3 (Fujimoto et al. 2018), the baseline.
    Td3,
}

/// What is added to the base algorithm's critic update.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Augmentation {
    /// Nothing.
    None,
    /// Imaginary one-step transitions with noisy actions, filtered (paper, section 4).
    Imagination,
}

impl Method {
    /// The name used in configurations and run directories.
    pub fn name(self) -> &'static str {
        match self {
            Method::Mamf => "mamf",
            Method::Td3 => "td3",
        }
    }

    /// What the method adds to its base.
    pub fn augmentation(self) -> Augmentation {
        match self {
            Method::Mamf => Augmentation::Imagination,
            Method::Td3 => Augmentation::None,
        }
    }

    /// Whether the method trains a dynamics model.
    pub fn learns_model(self) -> bool {
        self.augmentation() != Augmentation::None
    }
}
