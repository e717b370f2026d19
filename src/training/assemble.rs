//! From a configuration to everything a run is made of.

use super::clock::Clock;
use super::collector::{Collector, Episode, Side, Source};
use super::guidance::Guidance;
use super::metrics::Interval;
use super::rehearsal::{Following, recorded};
use super::segments::Segments;
use super::telemetry::{Probing, Reservoir};
use super::trainer::Trainer;
use super::{Evaluator, TrainError};
use crate::agent::augment::{Augment, Expansion, Imagination, Plain};
use crate::agent::{ActorCritic, Agent, AgentSettings, Imitation, Policy, TargetRule};
use crate::config::{Addition, Config, DoubledActions};
use crate::core::parallel::check_threads;
use crate::core::random::stream;
use crate::env::{self, Inspect, MakeError};
use crate::model::{DynamicsModel, DynamicsShape, RewardSource, World};
use crate::nn::{
    Architecture, Coupling, Mlp, ObservationScaling, RunningMoments, WeightError, Weights,
};
use crate::planning::{Planner, Worth};
use crate::recordings::{DemonstrationError, Demonstrations, Sizes};
use crate::replay::{ReplayBuffer, Uniform};
use crate::run::provenance::Provenance;
use crate::run::schema::{CONFIG_TOML, RUN_JSON};
use crate::run::{
    Checkpoint, CheckpointError, Curves, ReplayLog, ReplayMemory, RunDirectory, RunDirectoryError,
};
use crate::task::{Env, Rules, Spec};
use std::path::Path;
use std::sync::Arc;

/// The task of `config`, wrapped as configured.
///
/// # Errors
/// When there is no such task or MuJoCo can't run it.
pub fn make_env(config: &Config) -> Result<Box<dyn Inspect>, MakeError> {
    let task = env::make_inspect(&config.task)?;
    Ok(match &config.doubled_actions {
        None => task,
        Some(DoubledActions { period }) => env::doubled(task, *period),
    })
}

/// What the designer knows of the task of `config`, which is `spec`, wrapped as configured.
///
/// # Errors
/// When there is no such task or MuJoCo can't load its model.
pub fn make_rules(config: &Config, spec: &Spec) -> Result<Arc<dyn Rules>, MakeError> {
    let rules = env::rules(&config.task, config.rules.velocity)?;
    Ok(match &config.doubled_actions {
        None => rules,
        Some(DoubledActions { period }) => env::doubled_rules(rules, spec, *period),
    })
}

/// The coupling of actions as `spec` limits them.
pub(super) fn coupling(config: &Config, spec: &Spec) -> Coupling {
    Coupling::new(config.action_coupling, &spec.action_ranges)
}

/// The part of `config` that actor and critics are built from, for actions as `spec` says.
pub fn agent_settings(config: &Config, spec: &Spec) -> AgentSettings {
    AgentSettings {
        base: config.method.base(),
        networks: config.networks.clone(),
        coupling: coupling(config, spec),
        discount: config.discount,
        targets: TargetRule::Polyak { tau: config.tau },
        policy_delay: config.policy_delay,
        smoothing: config.target_smoothing.clone(),
        temperature: config.temperature.clone(),
        target_value: config.target_value,
        imitation: Imitation {
            weight: config.demonstrations.imitation,
            filter: config.demonstrations.imitation_filter,
        },
    }
}

/// The policy saved in `checkpoint`, for the task `spec`.
///
/// # Errors
/// When the arrays do not fit the task and the configuration.
pub fn saved_policy(checkpoint: &Checkpoint, spec: &Spec) -> Result<Policy, CheckpointError> {
    let settings = agent_settings(&checkpoint.config, spec);
    let architecture: Architecture = settings.actor(spec.obs_size, spec.action_size);
    let load = |weights: &Weights| -> Result<Policy, WeightError> {
        let actor = Mlp::load("actor", &architecture, weights)?;
        let scaling = ObservationScaling::load(spec.obs_size, weights)?;
        Ok(Policy::new(
            actor,
            settings.base,
            scaling,
            settings.coupling.clone(),
        ))
    };
    load(checkpoint.weights()).map_err(|error| checkpoint.misfit(error))
}

/// The planner of `config` for its task.
///
/// # Errors
/// When there is no such task or MuJoCo can't run it.
pub fn planner(config: &Config) -> Result<Planner, MakeError> {
    let env = make_env(config)?;
    let coupling = coupling(config, env.spec());
    drop(env);
    let settings = config.clone();
    let make = move || -> Box<dyn Env> {
        make_env(&settings).expect("another simulator of a task that there is one of already")
    };
    let workers = config.compute.threads;
    Ok(Planner::new(
        config.planner.clone(),
        Arc::new(make),
        workers,
        coupling,
    ))
}

/// The same with what `checkpoint`, which must be of that task, has learned: its policy, and what its critics say of states
/// where `planner.terminal_value` asks for it.
///
/// # Errors
/// When MuJoCo can't run the task, or the arrays do not fit it.
pub fn taught_planner(config: &Config, checkpoint: &Checkpoint) -> Result<Planner, TrainError> {
    let spec = make_env(config)?.spec().clone();
    let policy = saved_policy(checkpoint, &spec)?;
    let worth = || {
        let weights = checkpoint.weights();
        let scaling = ObservationScaling::load(spec.obs_size, weights)?;
        worth(&checkpoint.config, &spec, weights, scaling)
    };
    let worth = config.planner.terminal_value.then(worth).transpose();
    let worth = worth.map_err(|error| checkpoint.misfit(error))?;
    Ok(planner(config)?.with(Some(policy), worth))
}

/// What the critics in `weights` say of states of the task `spec`, under `scaling` and the policy there.
///
/// # Errors
/// When the arrays do not fit the task and the configuration.
pub(super) fn worth(
    config: &Config,
    spec: &Spec,
    weights: &Weights,
    scaling: ObservationScaling,
) -> Result<Worth, WeightError> {
    let device = config.compute.backend.device();
    let (obs_size, action_size) = (spec.obs_size, spec.action_size);
    let agent = agent_settings(config, spec);
    let core = ActorCritic::load(agent, obs_size, action_size, weights, &device)?;
    Ok(Arc::new(move |obs: &[f32], previous: &[f32]| {
        f64::from(core.value(obs, previous, &scaling)[0])
    }))
}

impl Trainer {
    /// Builds a run of `config`, whose task is `env` ([`make_env`]), and writes `config.toml` and `run.json` to the `directory`, which is made when all
    /// else is there. Where there are `demonstrations` (see [`demonstrations`]), experience comes in segments.
    ///
    /// # Errors
    /// When the task is unknown, there is not enough memory or a file can't be written.
    pub fn new(
        config: Config,
        env: Box<dyn Inspect>,
        demonstrations: Option<Demonstrations>,
        directory: impl FnOnce() -> Result<RunDirectory, RunDirectoryError>,
    ) -> Result<Trainer, TrainError> {
        Trainer::begin(config, env, demonstrations, directory, |provenance| {
            provenance.to_json()
        })
    }

    /// As [`new`](Trainer::new); `run_json` says what `run.json` is to hold.
    pub(super) fn begin(
        config: Config,
        env: Box<dyn Inspect>,
        demonstrations: Option<Demonstrations>,
        directory: impl FnOnce() -> Result<RunDirectory, RunDirectoryError>,
        run_json: impl FnOnce(Provenance) -> String,
    ) -> Result<Trainer, TrainError> {
        let spec = env.spec();
        let rules = make_rules(&config, spec)?;
        let begun_with = begun_with(&config)?;
        let mut agent = match &begun_with {
            None => fresh_agent(&config, spec, rules),
            Some(found) => saved_agent(&config, spec, rules, found.weights())
                .map_err(|error| found.misfit(error))?,
        };
        agent.recorded = recorded(&config, demonstrations.as_ref())?;
        let replay = empty_replay(&config, spec)?;
        require_threads(&config)?;
        let directory = directory()?;
        directory.write(CONFIG_TOML, &config.to_toml())?;
        directory.write(RUN_JSON, &run_json(Provenance::here()))?;
        let curves = Curves::create(directory.files(), directory.path())?;
        let mut trainer = Trainer::assemble(
            config,
            env,
            demonstrations,
            directory,
            curves,
            agent,
            replay,
        )?;
        if let Some(found) = begun_with {
            let scaling = ObservationScaling::load(trainer.moments.size(), found.weights());
            trainer.scaling = scaling.map_err(|error| found.misfit(error))?;
            if trainer.config.scaling.enabled {
                trainer.moments = RunningMoments::of(&trainer.scaling, found.step);
            }
        }
        Ok(trainer)
    }

    /// A run before its first step, of these parts.
    pub(super) fn assemble(
        config: Config,
        env: Box<dyn Inspect>,
        demonstrations: Option<Demonstrations>,
        directory: RunDirectory,
        curves: Curves,
        agent: Agent,
        replay: ReplayBuffer,
    ) -> Result<Trainer, TrainError> {
        let obs_size = env.spec().obs_size;
        let found = demonstrations.as_ref();
        let found = found.map(|set| [set.trajectories(), set.states()]);
        // What the planner makes joins them, even where there are none yet.
        let guided = (config.planner.every > 0).then(Demonstrations::default);
        let demonstrations = demonstrations.or(guided).map(Arc::new);
        Ok(Trainer {
            step: 0,
            largest_reward: f64::NEG_INFINITY,
            following: Following::new(&config, demonstrations.as_ref())?,
            guidance: Guidance::new(&config, demonstrations.as_ref())?,
            collector: collector(&config, env, demonstrations)?,
            demonstrations: found,
            probing: probing(&config, agent.augment.can_probe())?,
            agent,
            sampler: Box::new(Uniform),
            evaluator: Evaluator::new(&config, stream(config.seed, "eval-env"))?,
            replay,
            log: ReplayLog::new(&directory.replay()),
            needed: 0,
            moments: RunningMoments::new(obs_size),
            scaling: ObservationScaling::identity(obs_size),
            interval: Interval::default(),
            clock: Clock::new(0),
            best_return: None,
            last_return: None,
            told_full: false,
            evaluated: None,
            config,
            directory,
            curves,
        })
    }
}

/// What must be the same for networks to be begun with: otherwise they do not fit, or mean something else.
const SAME: [&str; 8] = [
    "task",
    "method",
    "action_coupling",
    "doubled_actions.period",
    "networks.hidden",
    "networks.critic_normalisation",
    "scaling.enabled",
    "rules.reward",
];

/// The checkpoint whose networks a run of `config` begins with, if it does not begin with fresh ones.
fn begun_with(config: &Config) -> Result<Option<Checkpoint>, TrainError> {
    let from = &config.networks.from;
    if from.is_empty() {
        return Ok(None);
    }
    let refused = |reason: String| TrainError::Networks {
        path: from.clone(),
        reason,
    };
    let found = Checkpoint::load(Path::new(from)).map_err(|error| refused(error.to_string()))?;
    let learns_model = config.method.learns_model();
    let matters = |key: &str| {
        SAME.contains(&key) || learns_model && ["model.hidden", "model.predict"].contains(&key)
    };
    let mut differences = found.config.differences(config).into_iter();
    let Some(difference) = differences.find(|difference| matters(&difference.key)) else {
        return Ok(Some(found));
    };
    let key = &difference.key;
    let [then, now] = difference
        .values
        .map(|value| value.unwrap_or_else(|| "unset".into()));
    Err(refused(format!(
        "trained with {key} = {then}, and this run has {now}"
    )))
}

/// Makes sure, before anything is written, that the threads of a run can be started.
pub(super) fn require_threads(config: &Config) -> Result<(), TrainError> {
    let threads = config.compute.threads;
    check_threads(threads).map_err(|error| TrainError::Threads { threads, error })
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

/// What imagined steps are measured with, if the augmentation can tell of them.
fn probing(config: &Config, can_probe: bool) -> Result<Option<Probing>, MakeError> {
    let states = config.telemetry.states;
    if !can_probe || states == 0 {
        return Ok(None);
    }
    let rng = stream(config.seed, "telemetry");
    Ok(Some(Probing {
        reservoir: Reservoir::new(states, rng),
        env: make_env(config)?,
    }))
}

/// The agent that `config` describes, for a task with sizes `spec`, before its first update.
pub fn fresh_agent(config: &Config, spec: &Spec, rules: Arc<dyn Rules>) -> Agent {
    let device = config.compute.backend.device();
    let model = |shape: DynamicsShape<'_>| {
        let rng = &mut stream(config.seed, "init-model");
        Ok(DynamicsModel::new(&config.model, shape, rng, &device))
    };
    let core = ActorCritic::new(
        agent_settings(config, spec),
        spec.obs_size,
        spec.action_size,
        &mut stream(config.seed, "init"),
        &device,
    );
    let augment = augment(config, spec, rules, model).expect("a fresh model fits");
    Agent::new(core, augment, config.seed)
}

/// The same with saved networks, without what its optimisers remember.
pub(super) fn saved_agent(
    config: &Config,
    spec: &Spec,
    rules: Arc<dyn Rules>,
    weights: &Weights,
) -> Result<Agent, WeightError> {
    let device = config.compute.backend.device();
    let model =
        |shape: DynamicsShape<'_>| DynamicsModel::load(&config.model, shape, weights, &device);
    let core = ActorCritic::load(
        agent_settings(config, spec),
        spec.obs_size,
        spec.action_size,
        weights,
        &device,
    )?;
    let augment = augment(config, spec, rules, model)?;
    Ok(Agent::new(core, augment, config.seed))
}

/// What the method of `config` adds to its base; `model` gives the dynamics model.
fn augment(
    config: &Config,
    spec: &Spec,
    rules: Arc<dyn Rules>,
    model: impl FnOnce(DynamicsShape<'_>) -> Result<DynamicsModel, WeightError>,
) -> Result<Box<dyn Augment>, WeightError> {
    let world = || {
        let shape = DynamicsShape {
            obs_size: spec.obs_size,
            action_size: spec.action_size,
            known: rules.known(),
            learns_reward: config.rules.reward == RewardSource::Learned,
        };
        Ok(World::new(model(shape)?, Arc::clone(&rules)))
    };
    let (ranges, seed) = (&spec.action_ranges, config.seed);
    Ok(match config.method.addition() {
        Addition::None => Box::new(Plain),
        Addition::Imagination => {
            let settings = &config.imagination;
            Box::new(Imagination::new(settings, ranges, world()?, seed))
        }
        Addition::Expansion => Box::new(Expansion::new(&config.expansion, world()?, seed)),
    })
}

/// The demonstrations that `config` asks for, for the task `spec`; none where their path is empty.
///
/// # Errors
/// When there are none at the path, or one is damaged or does not fit the task.
pub fn demonstrations(config: &Config, spec: &Spec) -> Result<Option<Demonstrations>, TrainError> {
    let path = &config.demonstrations.path;
    if path.is_empty() {
        return Ok(None);
    }
    let path = Path::new(path);
    let loaded = Demonstrations::load(path, &Sizes::of(spec));
    let loaded = loaded.map_err(|error| {
        let is_lost = matches!(error, DemonstrationError::Find(_)) && path.is_relative();
        let base = is_lost.then(std::env::current_dir).and_then(Result::ok);
        TrainError::Demonstrations { error, base }
    })?;
    Ok(Some(loaded))
}

/// The sources of experience, the first of which steps in `first`. Segments beside a main episode have an environment
/// of their own.
fn collector(
    config: &Config,
    first: Box<dyn Inspect>,
    demonstrations: Option<Arc<Demonstrations>>,
) -> Result<Collector, MakeError> {
    let mut made = Some(first);
    let ends = config.exploration.end_when_dropped;
    let sources = (0..config.environments).map(|number| {
        // The first one's streams have the names that they have in a run of one environment.
        let seeded = |name: &str| match number {
            0 => stream(config.seed, name),
            n => stream(config.seed, &format!("{name}-{n}")),
        };
        let env = match made.take() {
            Some(env) => env,
            None => make_env(config)?,
        };
        let side = demonstrations.as_ref().map(|set| {
            let settings = &config.demonstrations;
            Ok::<_, MakeError>(Side::new(
                Episode::new(make_env(config)?, seeded("segment-env"), ends),
                Arc::clone(set),
                Segments::new(settings),
                settings.segment_steps,
                seeded("segments"),
            ))
        });
        let main = Episode::new(env, seeded("env"), ends);
        Ok(Source::new(main, side.transpose()?, seeded("exploration")))
    });
    Ok(Collector::new(sources.collect::<Result<_, MakeError>>()?))
}
