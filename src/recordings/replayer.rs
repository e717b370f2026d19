//! A recording beside the simulation that it is compared with: states are put into it, steps taken, and what comes out
//! is measured. What is made of that is `verify`'s and `demo`'s.

use super::Sizes;
use super::errors::Errors;
use super::format::{Recording, RecordingError, Rows};
use crate::env::{self, Inspect, MakeError, PenInertia, Recorded};
use crate::task::{Start, Step};
use std::ops::Range;

/// Why a recording cannot be replayed.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ReplayError {
    /// Its task is unknown or cannot be run.
    #[error(transparent)]
    Make(#[from] MakeError),
    /// Its arrays do not fit the task.
    #[error(transparent)]
    Recording(#[from] RecordingError),
}

/// A recording and a simulation of its task.
pub(super) struct Replayer<'a> {
    pub recording: &'a Recording,
    pub env: Box<dyn Inspect>,
    /// What the recording leaves open of the task's state.
    pub recorded: Recorded,
    /// The goal of the recording; zeros for a task without one.
    pub goal: Vec<f64>,
    /// The observation after the last step or beginning.
    pub observation: Vec<f64>,
}

impl<'a> Replayer<'a> {
    /// A simulation of the task `id`, with pens as the recording had them, that watches approximate shapes.
    pub fn new(recording: &'a Recording, id: &str) -> Result<Self, ReplayError> {
        let env = env::make_watched(id, inertia(recording))?;
        check_columns(recording, env.as_ref())?;
        let spec = env.spec();
        Ok(Self {
            recording,
            recorded: env.recorded(),
            goal: match &recording.desired_goal {
                Some(goal) => goal.clone(),
                None => vec![0.0; spec.goal_size],
            },
            observation: vec![0.0; spec.obs_size],
            env,
        })
    }

    /// Begins an episode in a state, with a forward pass under the command of `previous_action`.
    pub fn begin(&mut self, qpos: &[f64], qvel: &[f64], previous_action: Option<&[f64]>) {
        let start = Start {
            qpos,
            qvel,
            previous_action,
            goal: &self.goal,
        };
        self.env.start_at(&start, &mut self.observation);
    }

    /// Writes the recorded state `t` over that of the step before, without a forward pass, and the accelerations that
    /// its step's solver starts from where they are recorded; false if there is no such state.
    pub fn write(&mut self, t: usize) -> bool {
        let (Some(qpos), Some(qvel)) = (self.recording.qpos.get(t), self.recording.qvel.get(t))
        else {
            return false;
        };
        self.env.set_state(qpos, qvel);
        self.warm_start(t);
        true
    }

    /// Has the next step's solver start where the recorded one of step `t` did, if that is recorded.
    pub fn warm_start(&mut self, t: usize) {
        if let Some(warmstart) = row(&self.recording.qacc_warmstart, t) {
            self.env.set_warmstart(warmstart);
        }
    }

    /// Takes a step.
    pub fn step(&mut self, action: &[f64]) -> Step {
        self.env.step(action, &mut self.observation)
    }

    /// Compares the positions with `qpos`, but for those on which nothing depends.
    pub fn compare_qpos(&self, errors: &mut Errors, qpos: &[f64]) {
        add_all_but(
            &self.recorded.idle_qpos,
            errors,
            self.env.qpos(),
            qpos,
            false,
        );
    }

    /// Compares the velocities with `qvel`, but for those on which nothing depends.
    pub fn compare_qvel(&self, errors: &mut Errors, qvel: &[f64], relative: bool) {
        add_all_but(
            &self.recorded.idle_qvel,
            errors,
            self.env.qvel(),
            qvel,
            relative,
        );
    }
}

/// Row `t` of an array that may not be recorded.
pub(super) fn row(rows: &Option<Rows>, t: usize) -> Option<&[f64]> {
    rows.as_ref().and_then(|rows| rows.get(t))
}

/// Which inertia the pens of a recording had, as its settings say.
pub(super) fn inertia(recording: &Recording) -> PenInertia {
    match &recording.pen_inertia {
        Some(words) if words.contains("compiled") || words.contains("derived") => {
            PenInertia::Derived
        }
        _ => PenInertia::Published,
    }
}

/// Makes sure that the rows are as long as the task's.
pub(super) fn check_columns(
    recording: &Recording,
    env: &dyn Inspect,
) -> Result<(), RecordingError> {
    let spec = env.spec();
    Sizes::of(spec).check(recording)?;
    // Without the goal neither rewards nor successes can be told.
    let goal_needed = recording.reward.is_some() || recording.success.is_some();
    if spec.goal_size > 0 && goal_needed && recording.desired_goal.is_none() {
        return Err(recording.missing("desired_goal"));
    }
    Ok(())
}

/// Compares number by number, but for the given ranges.
fn add_all_but(
    left_out: &[Range<usize>],
    errors: &mut Errors,
    found: &[f64],
    recorded: &[f64],
    relative: bool,
) {
    for (i, (&found, &recorded)) in found.iter().zip(recorded).enumerate() {
        if !left_out.iter().any(|range| range.contains(&i)) {
            errors.add(found, recorded, relative);
        }
    }
}
