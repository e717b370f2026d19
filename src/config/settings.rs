//! Every setting, its meaning, its unit and its published default.

use super::{Addition, DemonstrationSettings, Method};
use crate::agent::{AgentSettings, BaseAlgorithm, SmoothingSettings, TemperatureSettings};
use crate::env::{self, MakeError};
use crate::task::{Spec, VelocityReading};
use crate::imagination::{ExpansionSettings, ImaginaryLossMean, ImaginationSettings, TargetComparison, UncertaintyScale};
use crate::model::{ModelSettings, Predict, RewardSource};
use crate::nn::{Backend, Coupling, NetworkSettings, ScalingSettings};
use serde::{Deserialize, Serialize};
use std::collections::BTreeSet;
use std::sync::Arc;

/// A whole, resolved configuration. Defaults are the paper's figures (appendix B) where the paper
/// states one.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Config {
    /// Id of the task, for example `HalfCheetah-v4` (`mamf envs` lists them).
    pub task: String,
    /// Doubled actions, if the task is to have them.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub doubled_actions: Option<DoubledActions>,
    /// Method: its preset is what the other keys override.
    pub method: Method,
    /// Seed of every random stream.
    pub seed: u64,
    /// Environment steps of the run, phase 1 included.
    pub steps: u64,
    /// Steps of phase 1, in which actions are uniformly random (`h` in the paper).
    pub random_steps: u64,
    /// Step after which the dynamics model is trained (`h0` in the paper).
    pub model_start: u64,
    /// Transitions in a batch.
    pub batch_size: usize,
    /// Discount factor.
    pub discount: f64,
    /// `beta` in `a = beta u + (1 - beta) p`: share of the policy's output in the executed action,
    /// the rest being the previous executed action. 1 is plain TD3.
    pub action_coupling: f64,
    /// Deviation of the exploration noise, as a fraction of the action limit.
    pub exploration_noise: f64,
    /// Environment steps between two policy and target updates.
    pub policy_delay: u64,
    /// Updates of the critics (and of the model) an environment step.
    pub critic_updates: u64,
    /// Polyak averaging rate of the target networks.
    pub tau: f64,
    /// Networks and their optimiser.
    pub networks: NetworkSettings,
    /// Smoothing of the target policy.
    pub target_smoothing: SmoothingSettings,
    /// Temperature of SAC.
    pub temperature: TemperatureSettings,
    /// Observation scaling.
    pub scaling: ScalingSettings,
    /// Replay buffer.
    pub replay: Replay,
    /// Demonstrations from whose states segments of experience begin.
    pub demonstrations: DemonstrationSettings,
    /// Learned dynamics model.
    pub model: ModelSettings,
    /// Imaginary transitions.
    pub imagination: ImaginationSettings,
    /// Value expansion.
    pub expansion: ExpansionSettings,
    /// What the designer knows of the task.
    pub rules: Rules,
    /// Evaluation of the deterministic policy.
    pub evaluation: Evaluation,
    /// What evaluations measure besides returns.
    pub telemetry: Telemetry,
    /// Videos of the policy. Runs from before there were any have none.
    #[serde(default)]
    pub video: Video,
    /// Checkpoints.
    pub checkpoint: Checkpoint,
    /// Where and with how many threads tensors are computed.
    pub compute: Compute,
}

/// Actions that are pairs of the task's, of which one half acts at a time (paper, figure 3 c).
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct DoubledActions {
    /// Steps after which the halves change places.
    pub period: usize,
}

/// The replay buffer.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Replay {
    /// Transitions kept; the oldest are overwritten.
    pub capacity: usize,
}

/// What the designer knows of the task.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Rules {
    /// Whether imagined rewards come from the known rule or from the model.
    pub reward: RewardSource,
    /// Velocity read by the forward rewards.
    pub velocity: VelocityReading,
}

/// Evaluation of the deterministic policy in an environment of its own.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Evaluation {
    /// Environment steps between two evaluations.
    pub every: u64,
    /// Episodes of one evaluation.
    pub episodes: usize,
}

/// What evaluations measure besides returns.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Telemetry {
    /// States of the simulator, chosen at random since the last evaluation, in which imagined steps are
    /// executed; 0 for none.
    pub states: usize,
}

/// Videos of the policy in the run directory.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Video {
    /// Environment steps between two videos, a multiple of those between evaluations; 0 for none.
    pub every: u64,
}

/// Checkpoints in the run directory.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Checkpoint {
    /// Environment steps between two saves of `checkpoints/last`.
    pub every: u64,
    /// Whether the replay buffer is saved with it: without, a run can be evaluated but not resumed.
    pub replay: bool,
}

/// Where tensors are computed.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Compute {
    /// Tensor library.
    pub backend: Backend,
    /// Threads; results do not depend on it.
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
    /// Whether no result depends on the setting, and what a run stores does not either: it may change between two
    /// parts of a run without a word.
    pub fn is_free(&self) -> bool {
        ["steps", "compute.threads"].contains(&self.key.as_str())
    }
}

impl Config {
    /// As the text that [`read_resolved`](super::read_resolved) reads.
    pub fn to_toml(&self) -> String {
        toml::to_string_pretty(self).expect("a configuration is TOML")
    }

    /// What is set otherwise in `other`: key, value here and value there, in the order of the keys.
    pub fn differences(&self, other: &Config) -> Vec<Difference> {
        let [here, there] = [self, other].map(super::load::values);
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

    /// The task, wrapped as configured.
    ///
    /// # Errors
    /// When there is no such task or MuJoCo can't run it.
    pub fn env(&self) -> Result<Box<dyn env::Inspect>, MakeError> {
        let task = env::make_inspect(&self.task)?;
        Ok(match &self.doubled_actions {
            None => task,
            Some(DoubledActions { period }) => env::doubled(task, *period),
        })
    }

    /// What the designer knows of the task, wrapped as configured.
    ///
    /// # Errors
    /// When there is no such task or MuJoCo can't load its model.
    pub fn task_rules(&self) -> Result<Arc<dyn task::Rules>, MakeError> {
        let rules = env::rules(&self.task, self.rules.velocity)?;
        Ok(match &self.doubled_actions {
            None => rules,
            Some(DoubledActions { period }) => {
                let (plain, _) = env::make(&self.task)?;
                env::doubled_rules(rules, plain.spec(), *period)
            }
        })
    }

    /// The coupling of actions as `spec` limits them.
    pub fn coupling(&self, spec: &Spec) -> Coupling {
        Coupling {
            beta: self.action_coupling,
            limit: spec.action_limit,
        }
    }

    /// The part of the settings that the agent is built from, for actions as `spec` says.
    pub fn agent(&self, spec: &Spec) -> AgentSettings {
        AgentSettings {
            base: self.method.base(),
            networks: self.networks.clone(),
            coupling: self.coupling(spec),
            discount: self.discount,
            tau: self.tau,
            policy_delay: self.policy_delay,
            smoothing: self.target_smoothing.clone(),
            temperature: self.temperature.clone(),
        }
    }

    /// The preset of `method` for no task in particular: the paper's figures.
    pub fn preset(method: Method) -> Config {
        let imagines = method.addition() == Addition::Imagination;
        // MA-TD3 has the noise of TD3's target smoothing, and of the components only the filter by
        // uncertainty.
        let is_mamf = imagines && method != Method::MaTd3;
        Config {
            task: String::new(),
            doubled_actions: None,
            method,
            seed: 0,
            steps: 3_000_000,
            random_steps: 25_000,
            model_start: 5_000,
            batch_size: 256,
            discount: 0.98,
            action_coupling: 0.7,
            exploration_noise: 0.1,
            policy_delay: match method.base() {
                BaseAlgorithm::Td3 => 2,
                BaseAlgorithm::Ddpg | BaseAlgorithm::Sac => 1,
            },
            critic_updates: match method {
                Method::Td3Critic2 => 2,
                _ => 1,
            },
            tau: 0.005,
            networks: NetworkSettings {
                hidden: vec![256, 256],
                actor_learning_rate: 3e-4,
                critic_learning_rate: 3e-4,
            },
            target_smoothing: SmoothingSettings {
                deviation: 0.2,
                clip: 0.5,
            },
            temperature: TemperatureSettings {
                initial: 0.1,
                learning_rate: 3e-4,
            },
            scaling: ScalingSettings {
                enabled: true,
                every: 20,
                clip: 5.0,
                deviation_floor: 1e-2,
            },
            replay: Replay {
                capacity: 1_000_000,
            },
            demonstrations: DemonstrationSettings::default(),
            model: ModelSettings {
                hidden: vec![256, 256, 256],
                learning_rate: 1e-4,
                predict: Predict::NextState,
            },
            imagination: ImaginationSettings {
                optimism: is_mamf,
                noise_decay: is_mamf,
                target_filter: is_mamf,
                uncertainty_filter: imagines,
                noise_deviation: if method == Method::MaTd3 { 0.2 } else { 1.0 },
                noise_relative: method == Method::MaTd3,
                noise_bound: if method == Method::MaTd3 { 0.5 } else { 1.0 },
                bias_factor: 1.0 / 6.0,
                decay_rate: 0.999_999_6,
                target_comparison: TargetComparison::GreaterEqual,
                uncertainty_scale: UncertaintyScale::RunningMax,
                imaginary_loss_mean: ImaginaryLossMean::Kept,
            },
            expansion: ExpansionSettings { horizon: 3 },
            rules: Rules {
                reward: RewardSource::Known,
                velocity: VelocityReading::Mean,
            },
            evaluation: Evaluation {
                every: 5_000,
                episodes: 10,
            },
            telemetry: Telemetry { states: 256 },
            video: Video::default(),
            checkpoint: Checkpoint {
                every: 50_000,
                replay: true,
            },
            compute: Compute {
                backend: Backend::Flex,
                threads: 2,
            },
        }
    }
}
