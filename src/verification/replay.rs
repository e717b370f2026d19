//! Replays a rollout step by step.

use std::path::PathBuf;

use super::error::Errors;
use super::{RELATIVE_TOLERANCE, TOLERANCE};
use crate::env::{self, MakeError, Replay, Rules, VelocityReading};
use crate::recording::{Recording as Rollout, RecordingError as RolloutError, Rows};

/// Why a rollout cannot be replayed.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ReplayError {
    /// Its task is unknown or cannot be run.
    #[error(transparent)]
    Make(#[from] MakeError),
    /// Its arrays do not fit the task.
    #[error(transparent)]
    Rollout(#[from] RolloutError),
}

/// How the rules fare with one reading of the velocity.
#[derive(Debug, Clone, Default)]
pub struct RulesErrors {
    /// Rule against recorded reward.
    pub reward: Errors,
    /// Steps at which the rule and the simulator disagree on termination.
    pub terminated: usize,
}

impl RulesErrors {
    fn merge(&mut self, other: &RulesErrors) {
        self.reward.merge(&other.reward);
        self.terminated += other.terminated;
    }
}

/// The outcome of one rollout, or of several of one task.
#[derive(Debug, Clone)]
pub struct Summary {
    /// The file, or the first of several.
    pub path: PathBuf,
    /// Id of the task.
    pub env: String,
    /// Number of replayed steps.
    pub steps: usize,
    /// Observations, first ones included.
    pub obs: Errors,
    /// Rewards.
    pub reward: Errors,
    /// Positions after the steps.
    pub qpos: Errors,
    /// Velocities after the steps.
    pub qvel: Errors,
    /// Coordinates that the rules claim to know, against the simulated ones.
    pub known: Errors,
    /// The rules with the velocity read before the step.
    pub start: RulesErrors,
    /// The rules with the mean of the velocities before and after it; `None` if the task's reward
    /// reads no velocity and both readings are the same.
    pub mean: Option<RulesErrors>,
    /// Steps at which the simulator and the recording disagree on termination.
    pub terminated: usize,
    /// Steps at which the simulation diverged.
    pub diverged: usize,
    /// Whether observation, reward and velocity errors are relative to their size.
    pub relative: bool,
}

impl Summary {
    /// Whether the simulator reproduces the rollout.
    pub fn within_tolerance(&self) -> bool {
        let tolerance = self.tolerance();
        self.qpos.within(TOLERANCE)
            && [&self.obs, &self.reward, &self.qvel]
                .iter()
                .all(|errors| errors.within(tolerance))
            && self.terminated == 0
            && self.diverged == 0
    }

    /// Takes in the outcome of another rollout of the same task.
    pub fn merge(&mut self, other: &Summary) {
        self.steps += other.steps;
        self.obs.merge(&other.obs);
        self.reward.merge(&other.reward);
        self.qpos.merge(&other.qpos);
        self.qvel.merge(&other.qvel);
        self.known.merge(&other.known);
        self.start.merge(&other.start);
        if let (Some(mean), Some(other)) = (&mut self.mean, &other.mean) {
            mean.merge(other);
        }
        self.terminated += other.terminated;
        self.diverged += other.diverged;
    }

    /// The largest error of observations, rewards and velocities that passes.
    pub fn tolerance(&self) -> f64 {
        if self.relative {
            RELATIVE_TOLERANCE
        } else {
            TOLERANCE
        }
    }
}

/// Replays `rollout` from each of its states in turn.
///
/// The first state, and each that follows a reset inside the rollout, is set and a forward pass made;
/// the others are written over the state of the step before without one, so that what the tasks read
/// late is as late as in the recording.
///
/// # Errors
/// If the task is unknown or the arrays do not fit it.
pub fn replay(rollout: &Rollout) -> Result<Summary, ReplayError> {
    let info = env::info(&rollout.env).map_err(MakeError::from)?;
    let mut replayed = env::make_replay(&rollout.env)?;
    let start = env::rules(&rollout.env, VelocityReading::Start)?;
    let mean = env::rules(&rollout.env, VelocityReading::Mean)?;
    check_columns(rollout, replayed.as_ref())?;

    let mut summary = Summary {
        path: rollout.path.clone(),
        env: rollout.env.clone(),
        steps: 0,
        obs: Errors::default(),
        reward: Errors::default(),
        qpos: Errors::default(),
        qvel: Errors::default(),
        known: Errors::default(),
        start: RulesErrors::default(),
        mean: info.reads_velocity().then(RulesErrors::default),
        terminated: 0,
        diverged: 0,
        relative: info.relative,
    };
    let mut observation = vec![0.0; replayed.spec().obs_size];
    for t in 0..rollout.steps() {
        let (Some(qpos), Some(qvel), Some(action)) = (
            rollout.qpos.get(t),
            rollout.qvel.get(t),
            rollout.action.get(t),
        ) else {
            break;
        };
        if rollout.reset_before(t) {
            replayed.start_at(qpos, qvel, &mut observation);
            if let Some(recorded) = row(&rollout.obs, t) {
                summary.obs.add_all(&observation, recorded, info.relative);
            }
        } else {
            replayed.set_state(qpos, qvel);
        }
        if let Some(warmstart) = row(&rollout.qacc_warmstart, t) {
            replayed.set_warmstart(warmstart);
        }
        let before = single(row(&rollout.obs, t).unwrap_or(&observation));
        let step = replayed.step(action, &mut observation);

        summary.steps += 1;
        summary.diverged += usize::from(step.diverged);
        if !rollout.reset_before(t + 1) {
            if let Some(recorded) = row(&rollout.obs, t + 1) {
                summary.obs.add_all(&observation, recorded, info.relative);
            }
            if let Some(recorded) = rollout.qpos.get(t + 1) {
                summary.qpos.add_all(replayed.qpos(), recorded, false);
            }
            if let Some(recorded) = rollout.qvel.get(t + 1) {
                let relative = info.relative;
                summary.qvel.add_all(replayed.qvel(), recorded, relative);
            }
        }
        if let Some(recorded) = row(&rollout.reward, t) {
            summary.reward.add(step.reward, recorded[0], info.relative);
        }
        if let Some(recorded) = row(&rollout.terminated, t) {
            summary.terminated += usize::from(step.terminated != (recorded[0] != 0.0));
        }

        let recorded = row(&rollout.reward, t).map_or(step.reward, |r| r[0]);
        let action = single(action);
        let after = single(&observation);
        let score = |rules: &dyn Rules, errors: &mut RulesErrors| {
            let reward = rules.reward(&before, &action, &after);
            errors.reward.add(reward.into(), recorded, false);
            let terminated = rules.terminated(&after);
            errors.terminated += usize::from(terminated != step.terminated);
        };
        score(start.as_ref(), &mut summary.start);
        if let Some(errors) = &mut summary.mean {
            score(mean.as_ref(), errors);
        }
        let mut completed = after.clone();
        start.complete(&before, &action, &mut completed);
        for &i in start.known() {
            let (found, simulated) = (completed[i].into(), after[i].into());
            summary.known.add(found, simulated, true);
        }
    }
    Ok(summary)
}

/// Makes sure that the rows are as long as the task's.
fn check_columns(rollout: &Rollout, replayed: &dyn Replay) -> Result<(), RolloutError> {
    let spec = replayed.spec();
    let (nq, nv) = (replayed.qpos().len(), replayed.qvel().len());
    rollout.expect_columns("action", &rollout.action, spec.action_size)?;
    rollout.expect_columns("qpos", &rollout.qpos, nq)?;
    rollout.expect_columns("qvel", &rollout.qvel, nv)?;
    for (name, rows, columns) in [
        ("qacc_warmstart", &rollout.qacc_warmstart, nv),
        ("obs", &rollout.obs, spec.obs_size),
    ] {
        if let Some(rows) = rows {
            rollout.expect_columns(name, rows, columns)?;
        }
    }
    Ok(())
}

/// Row `t` of an array that may be absent.
fn row(rows: &Option<Rows>, t: usize) -> Option<&[f64]> {
    rows.as_ref()?.get(t)
}

/// In single precision, as learning sees it.
fn single(numbers: &[f64]) -> Vec<f32> {
    numbers.iter().map(|&x| x as f32).collect()
}
