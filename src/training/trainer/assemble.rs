//! From a configuration to everything a run is made of.

use super::clock::Clock;
use super::{Streams, Trainer};
use crate::agent::{Agent, Augmentation};
use crate::config::{Addition, Config};
use crate::env::{MakeError, Rules, Spec};
use crate::imagination::{DynamicsModel, DynamicsShape, Imagination, RewardSource, World};
use crate::nn::{ObservationScaling, RunningMoments, WeightError, Weights};
use crate::random::stream;
use crate::replay::{Demonstrations, ReplayBuffer, ReplayLog, Segments, Sizes};
use crate::training::curves::{Curves, Interval};
use crate::training::experience::{Experience, Runner, Side};
use crate::training::provenance::Provenance;
use crate::training::telemetry::{Probing, Reservoir};
use crate::training::{Evaluator, ReplayMemory, RunDirectory, TrainError};
use burn::tensor::Device;
use std::sync::Arc;

impl Trainer {
    /// Builds a run of `config` in `directory` and writes `config.toml` and `run.json`. Where there are
    /// `demonstrations` (see [`demonstrations`]), experience comes in segments.
    ///
    /// # Errors
    /// When the task is unknown, there is not enough memory or a file can't be written.
    pub fn new(
        config: Config,
        demonstrations: Option<Demonstrations>,
        directory: RunDirectory,
    ) -> Result<Trainer, TrainError> {
        let (env, rules) = (config.env()?, config.task_rules()?);
        let agent = fresh_agent(&config, env.spec(), rules);
        let replay = empty_replay(&config, env.spec())?;
        directory.write("config.toml", &config.to_toml())?;
        directory.write("run.json", &Provenance::here().to_json())?;
        let curves = Curves::create(directory.files(), directory.path())?;
        Trainer::assemble(config, demonstrations, directory, curves, agent, replay)
    }

    /// A run before its first step, of these parts.
    pub(super) fn assemble(
        config: Config,
        demonstrations: Option<Demonstrations>,
        directory: RunDirectory,
        curves: Curves,
        agent: Agent,
        replay: ReplayBuffer,
    ) -> Result<Trainer, TrainError> {
        let env = config.env()?;
        let obs_size = env.spec().obs_size;
        let seeded = |name| stream(config.seed, name);
        let found = demonstrations.as_ref();
        let found = found.map(|set| [set.trajectories(), set.states()]);
        let side = demonstrations.map(|set| side(&config, set)).transpose()?;
        Ok(Trainer {
            step: 0,
            largest_reward: f64::NEG_INFINITY,
            experience: Experience::new(Runner::new(env, seeded("env")), side),
            demonstrations: found,
            agent,
            evaluator: Evaluator::new(&config, seeded("eval-env"))?,
            probing: probing(&config)?,
            replay,
            log: ReplayLog::new(&directory.replay()),
            needed: 0,
            moments: RunningMoments::new(obs_size),
            scaling: ObservationScaling::identity(obs_size),
            streams: Streams {
                exploration: seeded("exploration"),
                replay: seeded("replay"),
                model_replay: seeded("model-replay"),
                smoothing: seeded("smoothing"),
                policy: seeded("policy"),
                imagination: seeded("imagination"),
            },
            interval: Interval::default(),
            clock: Clock::new(0),
            best_return: None,
            last_return: None,
            saved: None,
            config,
            directory,
            curves,
        })
    }
}

/// An empty replay buffer with the memory that a full one takes.
pub(super) fn empty_replay(config: &Config, spec: &Spec) -> Result<ReplayBuffer, TrainError> {
    let memory = ReplayMemory::of(config, spec);
    let mut replay = ReplayBuffer::new(memory.transitions, spec.obs_size, spec.action_size);
    match replay.reserve() {
        Ok(()) => Ok(replay),
        Err(error) => Err(TrainError::Replay { memory, error }),
    }
}

/// What imagined steps are measured with: none for methods that imagine no other actions.
fn probing(config: &Config) -> Result<Option<Probing>, MakeError> {
    let states = config.telemetry.states;
    if config.method.addition() != Addition::Imagination || states == 0 {
        return Ok(None);
    }
    let rng = stream(config.seed, "telemetry");
    Ok(Some(Probing {
        reservoir: Reservoir::new(states, rng),
        env: config.env()?,
    }))
}

/// The agent that `config` describes, for a task with sizes `spec`, before its first update.
pub fn fresh_agent(config: &Config, spec: &Spec, rules: Arc<dyn Rules>) -> Agent {
    let device = config.compute.backend.device();
    let model = |shape: DynamicsShape<'_>| {
        let rng = &mut stream(config.seed, "init-model");
        DynamicsModel::new(&config.model, shape, rng, &device)
    };
    Agent::new(
        config.agent(spec),
        spec.obs_size,
        spec.action_size,
        augmentation(config, spec, rules, |shape| Ok(model(shape))).expect("a fresh model fits"),
        &mut stream(config.seed, "init"),
        &device,
    )
}

/// The same with saved networks, without what its optimisers remember.
pub(super) fn saved_agent(
    config: &Config,
    spec: &Spec,
    rules: Arc<dyn Rules>,
    weights: &Weights,
) -> Result<Agent, WeightError> {
    let device: Device = config.compute.backend.device();
    let model =
        |shape: DynamicsShape<'_>| DynamicsModel::load(&config.model, shape, weights, &device);
    Agent::load(
        config.agent(spec),
        spec.obs_size,
        spec.action_size,
        augmentation(config, spec, rules, model)?,
        weights,
        &device,
    )
}

/// What the method of `config` adds to its base; `model` gives the dynamics model.
fn augmentation(
    config: &Config,
    spec: &Spec,
    rules: Arc<dyn Rules>,
    model: impl Fn(DynamicsShape<'_>) -> Result<DynamicsModel, WeightError>,
) -> Result<Augmentation, WeightError> {
    let world = || {
        let shape = DynamicsShape {
            obs_size: spec.obs_size,
            action_size: spec.action_size,
            known: rules.known(),
            learns_reward: config.rules.reward == RewardSource::Learned,
        };
        Ok(World::new(model(shape)?, Arc::clone(&rules)))
    };
    Ok(match config.method.addition() {
        Addition::None => Augmentation::None,
        Addition::Imagination => Augmentation::Imagination(Imagination::new(
            &config.imagination,
            spec.action_limit,
            world()?,
        )),
        Addition::Expansion => Augmentation::Expansion {
            world: world()?,
            horizon: config.expansion.horizon,
        },
    })
}

/// The demonstrations that `config` asks for, none where their path is empty.
///
/// # Errors
/// When there are none at the path, or one is damaged or does not fit the task.
pub fn demonstrations(config: &Config) -> Result<Option<Demonstrations>, TrainError> {
    let path = &config.demonstrations.path;
    if path.is_empty() {
        return Ok(None);
    }
    let env = config.env()?;
    let spec = env.spec();
    let sizes = Sizes::of(spec);
    Ok(Some(Demonstrations::load(path, &sizes)?))
}

/// The segments beside the main episode, in an environment of their own.
fn side(config: &Config, demonstrations: Demonstrations) -> Result<Side, MakeError> {
    let seeded = |name| stream(config.seed, name);
    let settings = &config.demonstrations;
    Ok(Side::new(
        Runner::new(config.env()?, seeded("segment-env")),
        demonstrations,
        Segments::new(settings),
        settings.segment_steps,
        seeded("segments"),
    ))
}
