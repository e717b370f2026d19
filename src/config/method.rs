//! The methods, as points of one small space: each is defined in one place, [`Method::definition`].

use crate::agent::BaseAlgorithm;
use serde::{Deserialize, Serialize};

/// A named point of the space *base algorithm x augmentation of the critic update x critic updates a
/// step*; its preset says the rest.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(into = "&'static str", try_from = "String")]
#[expect(missing_docs, reason = "each one's summary stands in its definition")]
pub enum Method {
    Mamf,
    MamfSac,
    Td3,
    Td3Critic2,
    MveTd3,
    MaTd3,
    Ddpg,
    Sac,
}

/// What a method is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Definition {
    /// The name used in configurations and run directories.
    pub name: &'static str,
    /// What it does, and where it comes from.
    pub summary: &'static str,
    /// What it builds on.
    pub base: BaseAlgorithm,
    /// What it adds to its base.
    pub addition: Addition,
    /// What it has otherwise than the defaults, as key and TOML: parts that several methods share, later ones on top.
    pub preset: &'static [Preset],
}

/// Keys and their values, as TOML.
pub type Preset = &'static [(&'static str, &'static str)];

/// Nothing is imagined: none of the four components is there.
const NO_IMAGINATION: Preset = &[
    ("imagination.optimism", "false"),
    ("imagination.noise_decay", "false"),
    ("imagination.target_filter", "false"),
    ("imagination.uncertainty_filter", "false"),
];

/// What the paper's text says otherwise than the code that its authors released, which the defaults follow.
pub(super) const TEXT_READINGS: Preset = &[
    ("imagination.target_comparison", "\"greater_equal\""),
    ("imagination.uncertainty_scale", "\"running_max\""),
    ("imagination.imaginary_loss_mean", "\"kept\""),
    ("rules.velocity", "\"mean\""),
];

/// The actor and the targets are updated whenever the critics are, as everywhere but in TD3.
const NO_DELAY: Preset = &[("policy_delay", "1")];

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

    /// What the method is: its name, what it does, and its preset.
    pub const fn definition(self) -> Definition {
        match self {
            Method::Mamf => Definition {
                name: "mamf",
                summary: "TD3 with imaginary transitions: the paper's method.",
                base: BaseAlgorithm::Td3,
                addition: Addition::Imagination,
                preset: &[],
            },
            Method::MamfSac => Definition {
                name: "mamf-sac",
                summary: "SAC with imaginary transitions (paper, appendix C).",
                base: BaseAlgorithm::Sac,
                addition: Addition::Imagination,
                preset: &[NO_DELAY],
            },
            Method::Td3 => Definition {
                name: "td3",
                summary: "Plain TD3 (Fujimoto et al. 2018), the baseline.",
                base: BaseAlgorithm::Td3,
                addition: Addition::None,
                preset: &[NO_IMAGINATION],
            },
            Method::Td3Critic2 => Definition {
                name: "td3-critic2",
                summary: "TD3 with two critic updates a step (paper, appendix C).",
                base: BaseAlgorithm::Td3,
                addition: Addition::None,
                preset: &[NO_IMAGINATION, &[("critic_updates", "2")]],
            },
            Method::MveTd3 => Definition {
                name: "mve-td3",
                summary: "TD3 with model-based value expansion (Feinberg et al. 2018).",
                base: BaseAlgorithm::Td3,
                addition: Addition::Expansion,
                preset: &[NO_IMAGINATION],
            },
            Method::MaTd3 => Definition {
                name: "ma-td3",
                summary: "TD3 with imaginary transitions filtered by uncertainty only, after MA-BDDPG \
                    (Kalweit and Boedecker 2017).",
                base: BaseAlgorithm::Td3,
                addition: Addition::Imagination,
                // The noise of TD3's target smoothing; of the four components only the filter by uncertainty.
                preset: &[&[
                    ("imagination.optimism", "false"),
                    ("imagination.noise_decay", "false"),
                    ("imagination.target_filter", "false"),
                    ("imagination.noise_deviation", "0.2"),
                    ("imagination.noise_relative", "true"),
                    ("imagination.noise_bound", "0.5"),
                ]],
            },
            Method::Ddpg => Definition {
                name: "ddpg",
                summary: "DDPG (Lillicrap et al. 2016): one critic.",
                base: BaseAlgorithm::Ddpg,
                addition: Addition::None,
                preset: &[NO_IMAGINATION, NO_DELAY],
            },
            Method::Sac => Definition {
                name: "sac",
                summary: "SAC with a learned temperature (Haarnoja et al. 2018).",
                base: BaseAlgorithm::Sac,
                addition: Addition::None,
                preset: &[NO_IMAGINATION, NO_DELAY],
            },
        }
    }

    /// The name used in configurations and run directories.
    pub fn name(self) -> &'static str {
        self.definition().name
    }

    /// The method called `name`.
    pub fn named(name: &str) -> Option<Method> {
        Method::ALL.into_iter().find(|method| method.name() == name)
    }

    /// What the method builds on.
    pub fn base(self) -> BaseAlgorithm {
        self.definition().base
    }

    /// What the method adds to its base.
    pub fn addition(self) -> Addition {
        self.definition().addition
    }

    /// Whether the method trains a dynamics model.
    pub fn learns_model(self) -> bool {
        self.addition() != Addition::None
    }
}

impl From<Method> for &'static str {
    fn from(method: Method) -> &'static str {
        method.name()
    }
}

impl TryFrom<String> for Method {
    type Error = String;

    fn try_from(name: String) -> Result<Method, String> {
        Method::named(&name).ok_or_else(|| format!("there is no method `{name}`"))
    }
}

/// The methods that have a use for a key.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Concern {
    /// All.
    All,
    /// Those that train a dynamics model.
    Model,
    /// Those that imagine other actions.
    Imagination,
    /// Those that expand values.
    Expansion,
    /// Those that have a temperature.
    Temperature,
    /// Those whose policy is deterministic.
    Deterministic,
    /// Those that have two critics.
    TwinCritics,
    /// Those that smooth the target policy.
    Smoothing,
    /// Those that add noise to the policy's actions.
    ExplorationNoise,
}

impl Concern {
    /// Whether `method` is one of them.
    pub fn includes(self, method: Method) -> bool {
        match self {
            Concern::All => true,
            Concern::Model => method.learns_model(),
            Concern::Imagination => method.addition() == Addition::Imagination,
            Concern::Expansion => method.addition() == Addition::Expansion,
            Concern::Temperature => method.base() == BaseAlgorithm::Sac,
            Concern::Deterministic => !method.base().is_stochastic(),
            Concern::TwinCritics => method.base().critics() == 2,
            Concern::Smoothing => method.base() == BaseAlgorithm::Td3,
            Concern::ExplorationNoise => method.base() != BaseAlgorithm::Sac,
        }
    }

    /// What sets the other methods apart, as the end of a sentence about one; none where there are no others.
    pub fn otherwise(self) -> Option<&'static str> {
        match self {
            Concern::All => None,
            Concern::Model => Some("trains no dynamics model"),
            Concern::Imagination => Some("imagines no other actions"),
            Concern::Expansion => Some("expands no values"),
            Concern::Temperature => Some("has no temperature"),
            Concern::Deterministic => {
                Some("has a stochastic policy, which neither imitates nor is kept from saturating")
            }
            Concern::TwinCritics => Some("has one critic"),
            Concern::Smoothing => Some("does not smooth the target policy"),
            Concern::ExplorationNoise => Some("explores by its policy's own noise"),
        }
    }
}
