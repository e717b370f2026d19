//! A configuration as typed values.

use super::Method;
use super::keys::{self, Resume};
use crate::agent::augment::{ExpansionSettings, ImaginationSettings};
use crate::agent::{SmoothingSettings, TargetValue, TemperatureSettings};
use crate::model::{ModelSettings, RewardSource};
use crate::nn::{Backend, NetworkSettings, ScalingSettings};
use crate::planning::PlannerSettings;
use crate::task::VelocityReading;
use serde::{Deserialize, Serialize};
use std::collections::BTreeSet;

/// A whole, resolved configuration. Each field has the name of a key, and of a section those in it; the
/// [table of keys](super::KEYS) says what they mean.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
#[expect(missing_docs, reason = "the table of keys says it")]
pub struct Config {
    pub task: String,
    pub method: Method,
    pub seed: u64,
    pub steps: u64,
    pub random_steps: u64,
    pub model_start: u64,
    pub environments: usize,
    pub batch_size: usize,
    pub discount: f64,
    pub action_coupling: f64,
    pub exploration_noise: f64,
    pub policy_delay: u64,
    pub critic_updates: u64,
    pub target_value: TargetValue,
    pub tau: f64,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub doubled_actions: Option<DoubledActions>,
    pub updates: Updates,
    pub exploration: Exploration,
    pub networks: NetworkSettings,
    pub target_smoothing: SmoothingSettings,
    pub temperature: TemperatureSettings,
    pub scaling: ScalingSettings,
    pub replay: Replay,
    pub demonstrations: DemonstrationSettings,
    pub model: ModelSettings,
    pub imagination: ImaginationSettings,
    pub expansion: ExpansionSettings,
    pub rules: Rules,
    pub evaluation: Evaluation,
    pub telemetry: Telemetry,
    pub video: Video,
    pub checkpoint: Checkpoint,
    pub planner: PlannerSettings,
    pub compute: Compute,
}

/// Actions that are pairs of the task's, of which one half acts at a time (paper, figure 3 c).
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
#[expect(missing_docs, reason = "the table of keys says it")]
pub struct DoubledActions {
    pub period: usize,
}

/// How often the networks learn.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
#[expect(missing_docs, reason = "the table of keys says it")]
pub struct Updates {
    pub every: u64,
}

/// Exploration in several environments.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
#[expect(missing_docs, reason = "the table of keys says it")]
pub struct Exploration {
    pub spread: Vec<f64>,
    pub end_when_dropped: bool,
}

/// The replay buffer.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
#[expect(missing_docs, reason = "the table of keys says it")]
pub struct Replay {
    pub capacity: usize,
}

/// Which demonstrations there are, how experience is divided into segments, and how often one begins in a
/// demonstration. The scheme is that of SCDM.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
#[expect(missing_docs, reason = "the table of keys says it")]
pub struct DemonstrationSettings {
    pub path: String,
    pub probability: f64,
    pub reset_probability: f64,
    pub decay: f64,
    pub segment_steps: u64,
    pub batch_share: f64,
    pub return_bound: bool,
    pub imitation: f64,
    pub imitation_filter: bool,
}

impl Default for DemonstrationSettings {
    fn default() -> DemonstrationSettings {
        Config::preset(Method::Mamf).demonstrations
    }
}

/// What the designer knows of the task.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
#[expect(missing_docs, reason = "the table of keys says it")]
pub struct Rules {
    pub reward: RewardSource,
    pub velocity: VelocityReading,
}

/// Evaluation of the deterministic policy in an environment of its own.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
#[expect(missing_docs, reason = "the table of keys says it")]
pub struct Evaluation {
    pub every: u64,
    pub episodes: usize,
}

/// What evaluations measure besides returns.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
#[expect(missing_docs, reason = "the table of keys says it")]
pub struct Telemetry {
    pub states: usize,
    pub recorded_states: usize,
}

/// Videos of the policy in the run directory.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
#[expect(missing_docs, reason = "the table of keys says it")]
pub struct Video {
    pub every: u64,
}

/// Checkpoints in the run directory.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
#[expect(missing_docs, reason = "the table of keys says it")]
pub struct Checkpoint {
    pub every: u64,
    pub replay: bool,
}

/// Where tensors are computed.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
#[expect(missing_docs, reason = "the table of keys says it")]
pub struct Compute {
    pub backend: Backend,
    pub threads: usize,
}

/// A setting that two configurations have different values for.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Difference {
    /// Its dotted key.
    pub key: String,
    /// Its values; none where it is not set.
    pub values: [Option<String>; 2],
}

impl Difference {
    /// Whether a run may be resumed with the other value.
    pub fn on_resume(&self) -> Resume {
        keys::find(&self.key).map_or(Resume::Fixed, |key| key.resume)
    }

    /// Whether no result depends on the setting, and what a run stores does not either: it may change between two
    /// parts of a run without a word.
    pub fn is_free(&self) -> bool {
        self.on_resume() == Resume::Free
    }
}

impl Config {
    /// As the text that [`read_resolved`](super::read_resolved) reads.
    pub fn to_toml(&self) -> String {
        toml::to_string_pretty(self).expect("a configuration is TOML")
    }

    /// What is set otherwise in `other`: key, value here and value there, in the order of the keys.
    pub fn differences(&self, other: &Config) -> Vec<Difference> {
        let [here, there] = [self, other].map(super::merge::values);
        let keys: BTreeSet<&String> = here.keys().chain(there.keys()).collect();
        let differs = keys
            .into_iter()
            .filter(|key| here.get(*key) != there.get(*key));
        differs
            .map(|key| Difference {
                key: key.clone(),
                values: [&here, &there].map(|values| values.get(key).map(ToString::to_string)),
            })
            .collect()
    }

    /// The preset of `method` for no task in particular: the paper's figures.
    pub fn preset(method: Method) -> Config {
        super::merge::typed(super::merge::preset(method))
    }

    /// Whether `key` means something here: not to a method that refuses it, nor while it is switched off.
    pub fn has_use_for(&self, key: &str) -> bool {
        let values = super::merge::values(self);
        keys::find(key).is_none_or(|key| {
            key.refusal(self.method).is_none() && key.switched_off(&values).is_none()
        })
    }
}
