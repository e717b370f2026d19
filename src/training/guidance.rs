//! Guided exploration: now and then the planner, with what was learned so far, makes an episode in the true simulator,
//! which joins the demonstrations. Its states become starts of segments, its steps recorded rows.

use super::TrainError;
use super::assemble::{self, make_env};
use super::evaluation::{EpisodeResult, Watch, run_episode};
use crate::agent::Agent;
use crate::config::Config;
use crate::core::files::{Checksum, FileError};
use crate::core::random::{Stream, stream};
use crate::env::{Inspect, MakeError};
use crate::nn::ObservationScaling;
use crate::planning::{PlannerSettings, Worthwhile};
use crate::recordings::demo::EpisodeRecorder;
use crate::recordings::{Demonstrations, Sizes};
use crate::run::checkpoint::damaged;
use crate::run::{CheckpointError, RunDirectory};
use crate::task::{Spec, Step};
use rand::SeedableRng;
use serde::{Deserialize, Serialize};
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

/// The planner's part in a run.
pub(super) struct Guidance {
    env: Box<dyn Inspect>,
    rng: Stream,
    /// Of each episode planned so far; none of one that was not recorded, for it diverged at once.
    planned: Vec<Option<Checksum>>,
    began_with: Checksum,
    /// The recordings that the run began with, and the planned ones after them.
    pub demonstrations: Arc<Demonstrations>,
}

/// The planner's part in a run, to go on from; the episodes lie beside the checkpoint.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(super) struct GuidanceState {
    rng: Stream,
    planned: Vec<Option<Checksum>>,
    /// Of the recordings that the run began with.
    began_with: Checksum,
}

/// What came of an episode that was due.
pub(super) enum Planned {
    /// It was made, and is the last one of [`Guidance::demonstrations`], unless it diverged at once and was not recorded.
    Made(EpisodeResult, Option<Demonstrations>),
    /// The run is to stop: nothing has changed.
    Abandoned,
}

impl Guidance {
    /// The planner's part in a run of `config` that begins with `demonstrations`, if it has one.
    ///
    /// # Errors
    /// When MuJoCo can't run the task.
    pub fn new(
        config: &Config,
        demonstrations: Option<&Arc<Demonstrations>>,
    ) -> Result<Option<Guidance>, MakeError> {
        let Some(demonstrations) = demonstrations.filter(|_| config.planner.every > 0) else {
            return Ok(None);
        };
        Ok(Some(Guidance {
            env: make_env(config)?,
            rng: stream(config.seed, "planner"),
            planned: Vec::new(),
            began_with: demonstrations.checksum(),
            demonstrations: Arc::clone(demonstrations),
        }))
    }

    /// Whether an episode is due after `step` steps.
    pub fn is_due(&self, config: &Config, step: u64) -> bool {
        let learning = step.saturating_sub(config.random_steps);
        learning / config.planner.every > self.planned.len() as u64
    }

    /// Plans an episode from a reset with the policy and the critics of `agent`, and records it beside the run.
    ///
    /// # Errors
    /// When MuJoCo can't run the task or the recording can't be written.
    pub fn plan(
        &mut self,
        config: &Config,
        agent: &Agent,
        scaling: &ObservationScaling,
        directory: &RunDirectory,
        stop: &AtomicBool,
    ) -> Result<Planned, TrainError> {
        let mut rng = self.rng.clone();
        let mut episode = Stream::from_rng(&mut rng);
        let worth = config.planner.terminal_value.then(|| {
            let (weights, scaling) = (agent.weights(), scaling.clone());
            let worth = assemble::worth(config, self.env.spec(), &weights, scaling);
            worth.expect("its own networks fit")
        });
        let mut planner = assemble::planner(config)?.with(Some(agent.policy(scaling)), worth);
        let source = format!(
            "mamf {}, planned in training ({})",
            env!("CARGO_PKG_VERSION"),
            config.planner.method.name()
        );
        let watcher = Recording {
            source: &source,
            settings: &config.planner,
            stop,
        };
        let env = self.env.as_mut();
        let (result, (recorder, _)) = run_episode(env, &mut planner, &mut episode, &watcher);
        if stop.load(Ordering::Relaxed) {
            return Ok(Planned::Abandoned);
        }
        let number = self.planned.len();
        let mut recorded = None;
        if result.length > 0 {
            let stem = stem(directory, number);
            directory.files().create_dir(&directory.planned())?;
            // What a run that was cut off left there.
            remove_from(directory, number)?;
            let saved = recorder.save(&stem, config.seed, number);
            saved.map_err(|error| TrainError::Planned { stem, error })?;
            let made = load(directory, number, self.env.spec())?;
            self.demonstrations = Arc::new(self.demonstrations.with(made.clone()));
            recorded = Some(made);
        }
        self.rng = rng;
        self.planned
            .push(recorded.as_ref().map(Demonstrations::checksum));
        Ok(Planned::Made(result, recorded))
    }

    /// What it goes on from.
    pub fn snapshot(&self) -> GuidanceState {
        GuidanceState {
            rng: self.rng.clone(),
            planned: self.planned.clone(),
            began_with: self.began_with,
        }
    }

    /// Goes on from `state`, whose [episodes](GuidanceState::episodes) are `planned`.
    ///
    /// # Errors
    /// When the run began with other recordings.
    pub fn restore(
        &mut self,
        state: GuidanceState,
        planned: Vec<Demonstrations>,
        config: &Config,
    ) -> Result<(), TrainError> {
        if self.began_with != state.began_with {
            let path = config.demonstrations.path.clone();
            return Err(TrainError::OtherDemonstrations(path));
        }
        let begun = Demonstrations::clone(&self.demonstrations);
        let all = planned.into_iter().fold(begun, |all, one| all.with(one));
        self.demonstrations = Arc::new(all);
        self.rng = state.rng;
        self.planned = state.planned;
        Ok(())
    }

    /// Removes from disk the episodes that were planned after the checkpoint that the run goes on from.
    pub fn forget_later(&self, directory: &RunDirectory) -> Result<(), FileError> {
        remove_from(directory, self.planned.len())
    }
}

impl GuidanceState {
    /// The recorded episodes, in order.
    ///
    /// # Errors
    /// When one is missing, damaged, or not the one that the run had planned.
    pub fn episodes(
        &self,
        directory: &RunDirectory,
        spec: &Spec,
    ) -> Result<Vec<Demonstrations>, CheckpointError> {
        let numbered = self.planned.iter().enumerate();
        let recorded = numbered.filter_map(|(number, checksum)| Some((number, (*checksum)?)));
        let checked = recorded.map(|(number, checksum)| {
            let found = load(directory, number, spec)?;
            if found.checksum() == checksum {
                return Ok(found);
            }
            let path = stem(directory, number).with_extension("npz");
            let reason = "it is not the episode that the run had planned";
            Err(damaged(path, reason))
        });
        checked.collect()
    }
}

/// Episode number `number`, from 0.
fn load(
    directory: &RunDirectory,
    number: usize,
    spec: &Spec,
) -> Result<Demonstrations, CheckpointError> {
    let path = stem(directory, number).with_extension("npz");
    if !path.exists() {
        return Err(damaged(path, "it is missing"));
    }
    Demonstrations::load(&path, &Sizes::of(spec)).map_err(|error| damaged(path, error))
}

/// The files of episode number `number`, from 0, without their endings.
fn stem(directory: &RunDirectory, number: usize) -> PathBuf {
    directory
        .planned()
        .join(format!("episode_{:06}", number + 1))
}

/// Removes the episodes from number `first` on.
fn remove_from(directory: &RunDirectory, first: usize) -> Result<(), FileError> {
    for number in first.. {
        let stem = stem(directory, number);
        let files = ["npz", "json"].map(|ending| stem.with_extension(ending));
        if !files.iter().any(|path| path.exists()) {
            break;
        }
        for path in files.iter().filter(|path| path.exists()) {
            directory.files().remove(path)?;
        }
    }
    Ok(())
}

/// Records an episode until it ends or the run is to stop.
struct Recording<'a> {
    source: &'a str,
    settings: &'a PlannerSettings,
    stop: &'a AtomicBool,
}

impl Watch for Recording<'_> {
    type Seen = (EpisodeRecorder, Worthwhile);

    fn begin(&self, env: &dyn Inspect, observation: &[f64]) -> Self::Seen {
        let recorder = EpisodeRecorder::begin(env, observation, self.source);
        (recorder, Worthwhile::new(self.settings))
    }

    fn step(
        &self,
        (recorder, worthwhile): &mut Self::Seen,
        env: &dyn Inspect,
        action: &[f64],
        step: &Step,
        observation: &[f64],
    ) {
        recorder.step(env, action, step, observation);
        worthwhile.see(step);
    }

    fn ends(&self, (_, worthwhile): &Self::Seen, step: &Step) -> bool {
        worthwhile.is_over(step) || self.stop.load(Ordering::Relaxed)
    }
}
