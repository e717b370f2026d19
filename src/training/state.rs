//! Saving a run, and going on from there to the last bit.

use super::TrainError;
use super::assemble::{
    demonstrations, empty_replay, make_env, make_rules, require_threads, saved_agent,
};
use super::clock::{Clock, ClockState};
use super::collector::CollectorState;
use super::guidance::{Guidance, GuidanceState};
use super::metrics::Interval;
use super::rehearsal::recorded;
use super::telemetry::Reservoir;
use super::trainer::{Monitor, Trainer};
use crate::config::{self, Config, Overrides, Resume};
use crate::core::files::FileError;
use crate::core::random::Stream;
use crate::env::Inspect;
use crate::nn::{LearningState, ObservationScaling, RunningMoments, WeightError, Weights};
use crate::recordings::Demonstrations;
use crate::replay::ReplayBuffer;
use crate::run::checkpoint::{self, WEIGHTS, damaged};
use crate::run::manifest::{Build, Manifest, Seal};
use crate::run::provenance::Provenance;
use crate::run::schema::{CONFIG_TOML, EVAL_CSV, RUN_JSON};
use crate::run::{
    Checkpoint, CheckpointError, Curves, DiskError, Logged, ReplayLog, ReplayLogError,
    ReplayMemory, RunDirectory, last_row,
};
use crate::task::Spec;
use serde::{Deserialize, Serialize};
use std::collections::{BTreeMap, HashMap};
use std::fs;
use std::path::{Path, PathBuf};
use std::time::Instant;

/// The optimisers' moments.
const OPTIMIZERS: &str = "optimizers.safetensors";
/// Everything else that a run goes on from.
const STATE: &str = "state.cbor";

/// What a run goes on from beside networks, optimisers' moments, replay buffer and curves: every random
/// stream, every simulator in use, statistics and counters. CBOR keeps its numbers to the last bit.
#[derive(Serialize, Deserialize)]
struct TrainerState {
    step: u64,
    largest_reward: f64,
    best_return: Option<f64>,
    last_return: Option<f64>,
    /// What the agent goes on from, but for its arrays.
    numbers: BTreeMap<String, f64>,
    streams: BTreeMap<String, Stream>,
    moments: RunningMoments,
    evaluation: Stream,
    collector: CollectorState,
    reservoir: Option<Reservoir>,
    guidance: Option<GuidanceState>,
    interval: Interval,
    clock: ClockState,
}

/// How a run is to go on.
#[derive(Debug, Default)]
pub struct ResumeOptions {
    /// Settings that may be changed: the steps of the run and the threads.
    pub overrides: Overrides,
    /// Whether to go on with another build of the program, or with changed settings of checkpoints.
    pub force: bool,
}

/// What there is to go on with.
pub enum Resumed {
    /// A run, at the step where it was saved.
    Run(Box<Trainer>),
    /// Nothing: the run took all its steps, so many.
    Finished(u64),
}

impl Trainer {
    /// Saves `checkpoints/last`; the one before it becomes `checkpoints/previous`.
    pub(super) fn save_last(&mut self) -> Result<(), TrainError> {
        let started = Instant::now();
        self.write_last()?;
        self.clock.checkpoint += started.elapsed();
        Ok(())
    }

    fn write_last(&mut self) -> Result<(), TrainError> {
        let mut learning = self.agent.state();
        self.sampler.save_state(&mut learning);
        let mut contents = self.evaluation_contents()?;
        if let Some(array) = learning.arrays.not_finite() {
            return Err(self.not_finite(self.step, format!("the array `{array}`")));
        }
        let logged = if self.config.checkpoint.replay {
            let state = self.state(learning.numbers, learning.streams);
            let mut bytes = Vec::new();
            ciborium::into_writer(&state, &mut bytes).expect("memory takes what is written to it");
            contents.push((STATE, bytes));
            // Before the first step of any optimiser there are no arrays, and a file without anything would
            // not be read back.
            let metadata = HashMap::from([("task".to_owned(), self.config.task.clone())]);
            let moments = learning.arrays.to_bytes(metadata);
            let moments = moments.expect("moments are of single precision");
            contents.push((OPTIMIZERS, moments));
            let logged = self.log.append(self.directory.files(), &self.replay);
            Some(self.on_disk(logged)?)
        } else {
            None
        };
        let mut manifest = manifest(self.step, &contents);
        if logged.is_some() {
            manifest.curves = self.on_disk(self.curves.seal())?;
        }
        manifest.replay = logged;
        let [last, previous] = ["last", "previous"].map(|name| self.directory.checkpoint(name));
        let files = self.directory.files();
        let written = checkpoint::write(files, &last, &contents, &manifest)
            .and_then(|()| checkpoint::stand(files, &last, Some(&previous)));
        self.on_disk(written)?;
        // The checkpoint stands: a chunk that can't be removed yet is tried again after the next one.
        let _ = self.log.prune(self.directory.files(), self.needed);
        self.needed = self.replay.stored().start;
        Ok(())
    }

    /// Saves `checkpoints/best`, to be evaluated.
    pub(super) fn save_best(&mut self) -> Result<(), TrainError> {
        let started = Instant::now();
        let contents = self.evaluation_contents()?;
        let manifest = manifest(self.step, &contents);
        let best = self.directory.checkpoint("best");
        let files = self.directory.files();
        let written = checkpoint::write(files, &best, &contents, &manifest)
            .and_then(|()| checkpoint::stand(files, &best, None));
        self.on_disk(written)?;
        self.clock.checkpoint += started.elapsed();
        Ok(())
    }

    fn evaluation_contents(&self) -> Result<checkpoint::Contents, TrainError> {
        let networks = self.agent.weights();
        if !self.scaling.is_finite() {
            return Err(self.not_finite(self.step, "the scaling of observations".to_owned()));
        }
        if let Some(array) = networks.not_finite() {
            return Err(self.not_finite(self.step, format!("the array `{array}`")));
        }
        let (config, scaling) = (&self.config, &self.scaling);
        let contents = Checkpoint::contents(config, self.step, self.last_return, networks, scaling);
        Ok(contents.expect("networks are of single precision"))
    }

    /// Adds the last good checkpoint to what a disk refused.
    pub(super) fn on_disk<T, E: Into<DiskError>>(
        &self,
        result: Result<T, E>,
    ) -> Result<T, TrainError> {
        result.map_err(|error| TrainError::Disk {
            error: error.into(),
            checkpoint: self.good_checkpoint(),
        })
    }

    /// The last good checkpoint, wherever what is going on has left it.
    pub(super) fn good_checkpoint(&self) -> Option<PathBuf> {
        let standing = checkpoint::standing(&self.directory.checkpoints());
        let best = self.directory.checkpoint("best");
        let newest = standing.into_iter().next();
        newest.or_else(|| best.exists().then_some(best))
    }

    fn state(
        &self,
        numbers: BTreeMap<String, f64>,
        streams: BTreeMap<String, Stream>,
    ) -> TrainerState {
        TrainerState {
            step: self.step,
            largest_reward: self.largest_reward,
            best_return: self.best_return,
            last_return: self.last_return,
            numbers,
            streams,
            moments: self.moments.clone(),
            evaluation: self.evaluator.stream().clone(),
            collector: self.collector.snapshot(),
            reservoir: self.probing.as_ref().map(|p| p.reservoir.clone()),
            guidance: self.guidance.as_ref().map(Guidance::snapshot),
            interval: self.interval.clone(),
            clock: self.clock.state(),
        }
    }

    /// The run in `directory`, to go on from its last good checkpoint exactly as it would have without the
    /// interruption. A damaged checkpoint is set aside for the one before it, of which `monitor` is told.
    ///
    /// # Errors
    /// When there is no run or no good checkpoint, the run can't be resumed, or what it depends on has
    /// changed; nothing in the directory is changed then.
    pub fn resume(
        directory: RunDirectory,
        options: &ResumeOptions,
        monitor: &mut dyn Monitor,
    ) -> Result<Resumed, TrainError> {
        let config = config::read_resolved(&directory.config(), &options.overrides)?;
        let env = make_env(&config)?;
        let spec = env.spec().clone();
        let memory = ReplayMemory::of(&config, &spec);
        memory.check()?;
        let found = checkpoint::standing(&directory.checkpoints());
        let Some(newest) = found.first() else {
            monitor.memory(&memory);
            return begin_again(config, env, directory, monitor);
        };
        if let Some(step) = finished(newest, directory.path(), &config) {
            // The run is done, whatever tidying up meets.
            if let Err(error) = tidy_up(&directory, &spec) {
                monitor.note(&format!("left as it is: {error}"));
            }
            return Ok(Resumed::Finished(step));
        }
        monitor.memory(&memory);
        let force = options.force;
        let read = |path: &Path| Point::read(path, &directory, &config, &spec, force);
        let (point, damage) = match (read(newest), found.get(1)) {
            (Ok(point), _) => (point, None),
            (Err(error), Some(older)) if error.is_damage() => match read(older) {
                Ok(point) => (point, Some(error)),
                Err(second) if second.is_damage() => {
                    return Err(TrainError::NoGoodCheckpoint {
                        last: Box::new(error),
                        previous: Box::new(second),
                    });
                }
                Err(second) => return Err(second),
            },
            (Err(error), _) => return Err(error),
        };
        if let Some(note) = point.manifest.build.other_processor(&Build::here()) {
            monitor.note(&note);
        }
        let set = demonstrations(&config, &spec)?;
        let (step, sealed) = (point.manifest.step, point.manifest.curves.clone());
        require_threads(&config)?;
        let mut trainer = point.assemble(config, env, set, directory)?;

        // Only from here on is anything changed.
        let (files, checkpoints) = (trainer.directory.files(), trainer.directory.checkpoints());
        checkpoint::recover(files, &checkpoints)?;
        if let Some(error) = damage {
            let aside = checkpoint::set_aside(files, &checkpoints)?;
            monitor.note(&format!(
                "{error}; going on from the checkpoint before it, of step {step}; the damaged one is kept as {}",
                aside.display()
            ));
        }
        trainer.forget_what_came_after(&sealed)?;
        Ok(Resumed::Run(Box::new(trainer)))
    }

    /// Removes from disk what was written after the checkpoint that the run goes on from, and notes in
    /// `run.json` that it does.
    fn forget_what_came_after(
        &mut self,
        sealed: &BTreeMap<String, Seal>,
    ) -> Result<(), TrainError> {
        let files = self.directory.files();
        if let Some(older) = logged(&self.directory, "previous") {
            self.log.keep(&older);
        }
        self.log.trim(files, self.replay.width())?;
        self.curves.cut(sealed)?;
        if let Some(guidance) = &self.guidance {
            guidance.forget_later(&self.directory)?;
        }
        self.evaluated = evaluated(self.directory.path());
        self.directory.write(CONFIG_TOML, &self.config.to_toml())?;
        let json = fs::read_to_string(self.directory.path().join(RUN_JSON)).unwrap_or_default();
        self.directory
            .write(RUN_JSON, &Provenance::here().after(&json, self.step))?;
        Ok(())
    }
}

/// A run that was interrupted before it saved anything, from its first step on.
fn begin_again(
    config: Config,
    env: Box<dyn Inspect>,
    directory: RunDirectory,
    monitor: &mut dyn Monitor,
) -> Result<Resumed, TrainError> {
    let path = directory.path().to_owned();
    let reached = evaluated(&path).unwrap_or(0);
    let due = config.checkpoint.every.min(config.steps);
    if reached >= due {
        return Err(TrainError::CheckpointsMissing { path, reached, due });
    }
    monitor.note("no checkpoint had been saved: the run begins again at step 0");
    let set = demonstrations(&config, env.spec())?;
    let json = fs::read_to_string(path.join(RUN_JSON)).unwrap_or_default();
    let emptied = || {
        directory.empty()?;
        Ok(directory)
    };
    let trainer = Trainer::begin(config, env, set, emptied, |provenance| {
        provenance.after(&json, 0)
    })?;
    Ok(Resumed::Run(Box::new(trainer)))
}

/// The steps of the run in `directory` if it has taken all of them and was evaluated after them, and its checkpoint at
/// `path` is whole.
fn finished(path: &Path, directory: &Path, config: &Config) -> Option<u64> {
    let checkpoint = Checkpoint::load(path).ok()?;
    let step = checkpoint.step;
    // A run that is not saved to go on can't be evaluated any more either.
    let is_done = evaluated(directory) >= Some(step) || !config.checkpoint.replay;
    (step == config.steps && is_done).then_some(step)
}

/// Steps before the last evaluation of the run in `directory`.
fn evaluated(directory: &Path) -> Option<u64> {
    last_row(&directory.join(EVAL_CSV))?.first()?.parse().ok()
}

/// What the checkpoint called `name` says of the replay buffer, if it is there and says so.
fn logged(directory: &RunDirectory, name: &str) -> Option<Logged> {
    let manifest = checkpoint::read_manifest(&directory.checkpoint(name));
    manifest.ok()?.replay
}

/// Removes what a crash left behind after the last checkpoint of a run stood.
fn tidy_up(directory: &RunDirectory, spec: &Spec) -> Result<(), FileError> {
    let files = directory.files();
    checkpoint::recover(files, &directory.checkpoints())?;
    let Some(last) = logged(directory, "last") else {
        return Ok(());
    };
    let mut log = ReplayLog::of(&directory.replay(), &last);
    if let Some(older) = logged(directory, "previous") {
        log.keep(&older);
    }
    log.trim(
        files,
        ReplayBuffer::row_width(spec.obs_size, spec.action_size),
    )
}

/// The steps of the run in `path` if it has taken all of them under `overrides`. Looks only, so that it can be said
/// of a run that can't be written to.
pub(super) fn finished_run(path: &Path, overrides: &Overrides) -> Option<u64> {
    let config = config::read_resolved(&path.join(CONFIG_TOML), overrides).ok()?;
    let found = checkpoint::standing(&path.join("checkpoints"));
    finished(found.first()?, path, &config)
}

fn manifest(step: u64, contents: &checkpoint::Contents) -> Manifest {
    let files = contents
        .iter()
        .map(|(name, bytes)| (*name, bytes.as_slice()));
    Manifest::new(step, files)
}

/// Refuses to go on from a checkpoint of `then` that `build` wrote where something has changed that the run depends
/// on.
fn compare(
    build: &Build,
    then: &Config,
    now: &Config,
    directory: &RunDirectory,
    force: bool,
) -> Result<(), TrainError> {
    let mut differences = build.differences(&Build::here());
    let mut harmless = true;
    for difference in then.differences(now) {
        if difference.is_free() {
            continue;
        }
        // Without demonstrations on one side there is nothing to compare.
        let set = |value: &Option<String>| value.as_ref().is_some_and(|v| v != "\"\"");
        let both = difference.values.iter().all(set);
        harmless &= difference.on_resume() == Resume::Forced && both;
        let [then, now] = difference
            .values
            .map(|value| value.unwrap_or_else(|| "unset".into()));
        differences.push(format!("{}: {then} then, {now} now", difference.key));
    }
    if differences.is_empty() || (force && harmless) {
        return Ok(());
    }
    Err(TrainError::Changed {
        path: directory.path().to_owned(),
        differences,
        harmless,
    })
}

/// A checkpoint that was read and found good.
struct Point {
    checkpoint: Checkpoint,
    manifest: Manifest,
    state: TrainerState,
    learning: LearningState,
    /// What the planner had made.
    planned: Vec<Demonstrations>,
    replay: ReplayBuffer,
    log: ReplayLog,
}

impl Point {
    /// Reads the checkpoint at `path` and all that it refers to, for a run of `config`, which must be that of the
    /// checkpoint as far as anything depends on it.
    fn read(
        path: &Path,
        directory: &RunDirectory,
        config: &Config,
        spec: &Spec,
        force: bool,
    ) -> Result<Point, TrainError> {
        let manifest = checkpoint::read_manifest(path)?;
        let checkpoint = Checkpoint::load(path)?;
        if manifest.step > config.steps {
            return Err(TrainError::StepsTaken {
                taken: manifest.step,
                asked: config.steps,
            });
        }
        compare(
            &manifest.build,
            &checkpoint.config,
            config,
            directory,
            force,
        )?;
        let Some(logged) = &manifest.replay else {
            return Err(TrainError::NotResumable(directory.path().to_owned()));
        };
        let read = |name| checkpoint::read(path, name, Some(&manifest));
        let wrong = |name: &str, error: String| damaged(path.join(name), error);
        let state: TrainerState = ciborium::from_reader(read(STATE)?.as_slice())
            .map_err(|error| wrong(STATE, error.to_string()))?;
        let planned = match &state.guidance {
            Some(guidance) => guidance.episodes(directory, spec)?,
            None => Vec::new(),
        };
        let moments = Weights::from_bytes(&read(OPTIMIZERS)?);
        let (arrays, _) = moments.map_err(|error| wrong(OPTIMIZERS, error.to_string()))?;
        for (name, seal) in &manifest.curves {
            let file = directory.path().join(name);
            let rows = fs::read(&file).map_err(FileError::at(&file));
            let rows = rows.map_err(CheckpointError::from)?;
            seal.open(&rows).map_err(|reason| damaged(file, reason))?;
        }
        let mut replay = empty_replay(config, spec)?;
        let log = ReplayLog::read(&directory.replay(), logged, &mut replay);
        let log = log.map_err(|error| match error {
            ReplayLogError::File(error) => CheckpointError::File(error),
            ReplayLogError::Damaged { path, reason } => damaged(path, reason),
        })?;
        let learning = LearningState {
            arrays,
            numbers: state.numbers.clone(),
            streams: state.streams.clone(),
        };
        Ok(Point {
            checkpoint,
            manifest,
            state,
            learning,
            planned,
            replay,
            log,
        })
    }

    /// The run, at the step where it was saved. Nothing is written.
    fn assemble(
        self,
        config: Config,
        env: Box<dyn Inspect>,
        set: Option<Demonstrations>,
        directory: RunDirectory,
    ) -> Result<Trainer, TrainError> {
        let Point {
            checkpoint,
            manifest,
            state,
            learning,
            planned,
            replay,
            log,
        } = self;
        let damage = |name: &str, reason: String| damaged(checkpoint.path.join(name), reason);
        let rules = make_rules(&config, env.spec())?;
        let obs_size = env.spec().obs_size;
        if state.moments.size() != obs_size || state.step != manifest.step {
            let reason = "it is of another task or another step".to_owned();
            return Err(damage(STATE, reason).into());
        }
        let misfit = |error: WeightError| damage(WEIGHTS, error.to_string());
        let weights = checkpoint.weights();
        let scaling = ObservationScaling::load(obs_size, weights).map_err(misfit)?;
        let mut agent = saved_agent(&config, env.spec(), rules, weights).map_err(misfit)?;
        // A planner's part knows what the run began with, and has more to rehearse.
        if state.guidance.is_none() {
            let then = state.collector.demonstrations();
            if then != set.as_ref().map(Demonstrations::checksum) {
                return Err(TrainError::OtherDemonstrations(config.demonstrations.path));
            }
            agent.recorded = recorded(&config, set.as_ref())?;
        }
        let curves = Curves::open(directory.files(), directory.path(), &manifest.curves)?;
        let mut trainer = Trainer::assemble(config, env, set, directory, curves, agent, replay)?;
        match (&mut trainer.guidance, state.guidance) {
            (Some(guidance), Some(state)) => {
                guidance.restore(state, planned, &trainer.config)?;
                let all = &guidance.demonstrations;
                trainer.collector.set_demonstrations(all);
                trainer.agent.recorded = recorded(&trainer.config, Some(all))?;
            }
            (None, None) => (),
            _ => {
                return Err(damage(
                    STATE,
                    "it is of a run with a planner, or without".to_owned(),
                )
                .into());
            }
        }
        let restored = trainer.agent.restore(&learning);
        restored.map_err(|error| damage(OPTIMIZERS, error.to_string()))?;
        let collector = trainer.collector.restore(state.collector);
        collector.map_err(|reason| damage(STATE, reason))?;
        match (&mut trainer.probing, state.reservoir) {
            (Some(probing), Some(reservoir)) => probing.reservoir = reservoir,
            (None, None) => (),
            _ => return Err(damage(STATE, "it is of another method".to_owned()).into()),
        }
        let restored = trainer.sampler.restore(&learning);
        restored.map_err(|error| damage(OPTIMIZERS, error.to_string()))?;
        trainer.step = state.step;
        trainer.largest_reward = state.largest_reward;
        trainer.best_return = state.best_return;
        trainer.last_return = state.last_return;
        trainer.moments = state.moments;
        trainer.scaling = scaling;
        trainer.evaluator.set_stream(state.evaluation);
        trainer.interval = state.interval;
        trainer.clock = Clock::resume(state.clock);
        trainer.log = log;
        trainer.needed = trainer.replay.stored().start;
        Ok(trainer)
    }
}

/// Whether the run in `directory` could go on from the checkpoint at `path`.
#[cfg(test)]
pub(super) fn is_sound(
    path: &Path,
    directory: &RunDirectory,
    config: &Config,
    spec: &Spec,
) -> Result<(), TrainError> {
    Point::read(path, directory, config, spec, false).map(|_| ())
}
