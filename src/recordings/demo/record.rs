//! Turns the steps of an episode into a recording.

use crate::core::leftovers::Unfinished;
use std::path::Path;

use crate::env::Inspect;
use crate::recordings::format::{Recorder, State, Step, WriteError};

/// The recording of an episode in the making, kept in memory.
#[derive(Debug, Clone)]
pub struct EpisodeRecorder {
    recorder: Recorder,
    episode_return: f64,
}

impl EpisodeRecorder {
    /// Begins with the state that `env` is in, which it observed as `observation`, `[obs_size]`;
    /// `source` says where the episode comes from.
    pub fn begin(env: &dyn Inspect, observation: &[f64], source: &str) -> EpisodeRecorder {
        let id = &env.spec().id;
        let (_, goal) = split(env, observation);
        let mut recorder = with_state(env, observation, |state| Recorder::new(id, source, state));
        if !goal.is_empty() {
            recorder = recorder.with_desired_goal(goal);
        }
        if env.recorded().has_pens {
            recorder = recorder.with_setting("pen_inertia", "published");
        }
        EpisodeRecorder {
            recorder,
            episode_return: 0.0,
        }
    }

    /// Appends the step that `action` made, with its `outcome` and the `observation` that follows it.
    /// Nothing is appended where the simulation diverged.
    pub fn step(
        &mut self,
        env: &dyn Inspect,
        action: &[f64],
        outcome: &crate::task::Step,
        observation: &[f64],
    ) {
        if outcome.diverged {
            return;
        }
        self.episode_return += outcome.reward;
        let step = Step {
            action,
            ctrl: Some(env.ctrl()),
            reward: outcome.reward,
            terminated: outcome.terminated,
            success: outcome.success,
        };
        with_state(env, observation, |state| self.recorder.push(&step, state));
    }

    /// Writes `<stem>.npz` and `<stem>.json`, which says besides that the episode was number `episode`
    /// (from 0) of those with `seed`. Until what is returned is dropped, both go with the process.
    ///
    /// # Errors
    /// If one of the files exists or cannot be written, or there is no step.
    pub fn save(
        self,
        stem: &Path,
        seed: u64,
        episode: usize,
    ) -> Result<[Unfinished; 2], WriteError> {
        self.recorder
            .with_setting("return", self.episode_return)
            .with_setting("seed", seed)
            .with_setting("episode", episode)
            .save(stem)
    }
}

/// State and goal in an observation.
fn split<'a>(env: &dyn Inspect, observation: &'a [f64]) -> (&'a [f64], &'a [f64]) {
    let spec = env.spec();
    observation.split_at(spec.obs_size - spec.goal_size)
}

/// Hands the state that `env` is in to `record`.
fn with_state<T>(
    env: &dyn Inspect,
    observation: &[f64],
    record: impl FnOnce(&State<'_>) -> T,
) -> T {
    let state = env.snapshot();
    let achieved = env.achieved_goal();
    record(&State {
        qpos: &state.qpos,
        qvel: &state.qvel,
        qacc_warmstart: &state.qacc_warmstart,
        time: state.time,
        // Recordings hold the goal once, beside the observations.
        obs: split(env, observation).0,
        achieved_goal: (!achieved.is_empty()).then_some(&achieved),
    })
}
