//! Replays a recorded rollout step by step.

use std::path::PathBuf;
use std::sync::Arc;

use super::{RELATIVE_TOLERANCE, TOLERANCE};
use crate::env::{self, MakeError, PenInertia};
use crate::recordings::format::Recording;
use crate::recordings::replayer::{Replayer, inertia, row};
use crate::recordings::{Errors, ReplayError};
use crate::task::{Rules, Step, VelocityReading, dense};

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

/// How far the simulator is from the recording, quantity by quantity.
#[derive(Debug, Clone, Default)]
pub struct Differences {
    /// State and observation after settling, where the recording tells what came before.
    pub settling: Errors,
    /// Commands that actions map to.
    pub ctrl: Errors,
    /// Observations, first ones included.
    pub obs: Errors,
    /// Achieved goals; and how far the desired goal lies from those that the task can draw.
    pub goal: Errors,
    /// Rewards.
    pub reward: Errors,
    /// Rewards of the sparse variant: success - 1.
    pub sparse: Errors,
    /// Positions after the steps.
    pub qpos: Errors,
    /// Velocities after the steps.
    pub qvel: Errors,
    /// Steps at which only one of simulator and recording reports success.
    pub success: usize,
    /// Steps at which only one of simulator and recording terminates.
    pub terminated: usize,
}

impl Differences {
    fn merge(&mut self, other: &Differences) {
        self.settling.merge(&other.settling);
        self.ctrl.merge(&other.ctrl);
        self.obs.merge(&other.obs);
        self.goal.merge(&other.goal);
        self.reward.merge(&other.reward);
        self.sparse.merge(&other.sparse);
        self.qpos.merge(&other.qpos);
        self.qvel.merge(&other.qvel);
        self.success += other.success;
        self.terminated += other.terminated;
    }

    /// Whether no difference exceeds `tolerance`; that of positions and settling is absolute.
    fn within(&self, tolerance: f64) -> bool {
        let absolute = [&self.settling, &self.ctrl, &self.goal, &self.qpos];
        let scaled = [&self.obs, &self.reward, &self.sparse, &self.qvel];
        absolute.iter().all(|errors| errors.within(TOLERANCE))
            && scaled.iter().all(|errors| errors.within(tolerance))
            && self.success == 0
            && self.terminated == 0
    }
}

/// The outcome of one rollout, or of several of one task.
#[derive(Debug, Clone)]
pub struct Summary {
    /// The file, or the first of several.
    pub path: PathBuf,
    /// Id of the task.
    pub env: String,
    /// Which inertia the pens of the rollout had.
    pub inertia: PenInertia,
    /// Number of replayed steps.
    pub steps: usize,
    /// Simulator against recording, without the steps of [`touched`](Summary::touched).
    pub differences: Differences,
    /// Steps in which something came near a shape that only approximates the published one (and
    /// settlings, which count as one).
    pub touched: usize,
    /// Simulator against recording in those steps.
    pub touched_differences: Differences,
    /// Whether the task has such shapes.
    pub watched: bool,
    /// Whether the recording tells successes.
    pub has_success: bool,
    /// Whether the recording tells terminations.
    pub has_ends: bool,
    /// Coordinates that the rules claim to know, against the simulated ones.
    pub known: Errors,
    /// The rules with the velocity read before the step.
    pub start: RulesErrors,
    /// The rules with the mean of the velocities before and after it; `None` if the task's reward
    /// reads no velocity and both readings are the same.
    pub mean: Option<RulesErrors>,
    /// Steps at which the simulation diverged.
    pub diverged: usize,
    /// Whether observation, reward and velocity errors are relative to their size.
    pub relative: bool,
}

impl Summary {
    /// Whether the simulator reproduces the rollout, but for the steps in which something touched an
    /// approximate shape.
    pub fn within_tolerance(&self) -> bool {
        self.is_judged() && self.differences.within(self.tolerance()) && self.diverged == 0
    }

    /// Whether a step was compared at all: not where each touches an approximate shape, or none is
    /// followed by a recorded state.
    pub fn is_judged(&self) -> bool {
        self.differences.qpos.largest().is_some()
    }

    /// Whether `other` is of the same task with the same figures.
    pub fn is_alike(&self, other: &Summary) -> bool {
        self.env == other.env && self.inertia == other.inertia
    }

    /// Takes in the outcome of another rollout of the same task.
    pub fn merge(&mut self, other: &Summary) {
        self.steps += other.steps;
        self.differences.merge(&other.differences);
        self.touched += other.touched;
        self.touched_differences.merge(&other.touched_differences);
        self.has_success |= other.has_success;
        self.has_ends |= other.has_ends;
        self.known.merge(&other.known);
        self.start.merge(&other.start);
        if let (Some(mean), Some(other)) = (&mut self.mean, &other.mean) {
            mean.merge(other);
        }
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
pub fn replay(rollout: &Recording) -> Result<Summary, ReplayError> {
    let mut comparison = Comparison::new(rollout)?;
    comparison.settle();
    for t in 0..rollout.steps() {
        comparison.step(t);
    }
    Ok(comparison.summary)
}

/// A rollout beside the simulation, and what was found so far.
struct Comparison<'a> {
    replayer: Replayer<'a>,
    start: Arc<dyn Rules>,
    mean: Arc<dyn Rules>,
    summary: Summary,
}

impl<'a> Comparison<'a> {
    fn new(rollout: &'a Recording) -> Result<Self, ReplayError> {
        let id = rewarded(rollout);
        let info = env::info(&id).map_err(MakeError::from)?;
        let replayer = Replayer::new(rollout, &id)?;
        Ok(Self {
            start: env::rules(&id, VelocityReading::Start)?,
            mean: env::rules(&id, VelocityReading::Mean)?,
            summary: Summary {
                path: rollout.path.clone(),
                env: rollout.env.clone(),
                inertia: inertia(rollout),
                steps: 0,
                differences: Differences::default(),
                touched: 0,
                touched_differences: Differences::default(),
                watched: !replayer.recorded.approximate_geoms.is_empty(),
                has_success: rollout.success.is_some(),
                has_ends: rollout.terminated.is_some(),
                known: Errors::default(),
                start: RulesErrors::default(),
                mean: info.reads_velocity().then(RulesErrors::default),
                diverged: 0,
                relative: info.relative,
            },
            replayer,
        })
    }

    /// Settles as a reset does, if the recording tells from where, and looks at the goal.
    fn settle(&mut self) {
        let rollout = self.replayer.recording;
        let mut found = Differences::default();
        if rollout.desired_goal.is_some()
            && let Some(first) = rollout.qpos.get(0)
        {
            // Where objects settled tells the region only if they just did.
            let begins = self.begins_with_reset();
            let error = self
                .replayer
                .env
                .goal_error(first, &self.replayer.goal, begins);
            found.goal.add(error, 0.0, false);
        }
        if let (Some(qpos), Some(qvel)) = (&rollout.presettle_qpos, &rollout.presettle_qvel) {
            self.replayer.begin(qpos, qvel, None);
            if let Some(warmstart) = &rollout.presettle_qacc_warmstart {
                self.replayer.env.set_warmstart(warmstart);
            }
            let Replayer {
                env, observation, ..
            } = &mut self.replayer;
            env.settle(observation);
            if let Some(ctrl) = &rollout.settle_ctrl {
                found.ctrl.add_all(self.replayer.env.ctrl(), ctrl, false);
            }
            if let (Some(qpos), Some(qvel)) = (rollout.qpos.get(0), rollout.qvel.get(0)) {
                self.replayer.compare_qpos(&mut found.settling, qpos);
                self.replayer.compare_qvel(&mut found.settling, qvel, false);
            }
            if let Some(recorded) = row(&rollout.obs, 0) {
                found
                    .settling
                    .add_all(&self.replayer.observation, recorded, false);
            }
        }
        self.file(&mut found);
    }

    /// Whether the first row is the state that a reset left.
    fn begins_with_reset(&self) -> bool {
        let time = row(&self.replayer.recording.time, 0).map(|time| time[0]);
        self.replayer.recording.presettle_qpos.is_some()
            || time.is_some_and(|time| time <= self.replayer.env.settling_time() + 1e-6)
    }

    fn step(&mut self, t: usize) {
        let rollout = self.replayer.recording;
        let (Some(qpos), Some(qvel), Some(action)) = (
            rollout.qpos.get(t),
            rollout.qvel.get(t),
            rollout.action.get(t),
        ) else {
            return;
        };
        let mut found = Differences::default();
        if rollout.reset_before(t) {
            self.replayer.begin(qpos, qvel, None);
            self.compare_observation(&mut found, t);
            self.replayer.warm_start(t);
        } else {
            self.replayer.write(t);
        }
        let before = self.before(t);
        let step = self.replayer.step(action);

        self.summary.steps += 1;
        self.summary.diverged += usize::from(step.diverged);
        self.compare_step(&mut found, t, &step);
        if !rollout.reset_before(t + 1) {
            self.compare_observation(&mut found, t + 1);
            self.compare_positions(&mut found, t + 1);
        }
        self.compare_rules(t, &before, action, &step);
        self.file(&mut found);
    }

    /// The observation on which action `t` was taken, recorded or else simulated, in the form that
    /// rules read.
    fn before(&self, t: usize) -> Vec<f32> {
        let mut before = single(&self.replayer.observation);
        if let Some(recorded) = row(&self.replayer.recording.obs, t) {
            for (x, recorded) in before.iter_mut().zip(recorded) {
                *x = *recorded as f32;
            }
        }
        before
    }

    fn compare_observation(&self, found: &mut Differences, t: usize) {
        let relative = self.summary.relative;
        if let Some(recorded) = row(&self.replayer.recording.obs, t) {
            found
                .obs
                .add_all(&self.replayer.observation, recorded, relative);
        }
        if let Some(recorded) = row(&self.replayer.recording.achieved_goal, t) {
            let achieved = self.replayer.env.achieved_goal();
            found.goal.add_all(&achieved, recorded, relative);
        }
    }

    fn compare_positions(&self, found: &mut Differences, t: usize) {
        let relative = self.summary.relative;
        if let Some(recorded) = self.replayer.recording.qpos.get(t) {
            self.replayer.compare_qpos(&mut found.qpos, recorded);
        }
        if let Some(recorded) = self.replayer.recording.qvel.get(t) {
            let errors = &mut found.qvel;
            self.replayer.compare_qvel(errors, recorded, relative);
        }
    }

    fn compare_step(&self, found: &mut Differences, t: usize, step: &Step) {
        let rollout = self.replayer.recording;
        if let Some(recorded) = row(&rollout.ctrl, t) {
            found
                .ctrl
                .add_all(self.replayer.env.ctrl(), recorded, false);
        }
        if let Some(recorded) = row(&rollout.reward, t) {
            let relative = self.summary.relative;
            found.reward.add(step.reward, recorded[0], relative);
        }
        if let Some(recorded) = row(&rollout.terminated, t) {
            found.terminated += usize::from(step.terminated != (recorded[0] != 0.0));
        }
        let Some(success) = step.success else {
            return;
        };
        if let Some(recorded) = row(&rollout.success, t) {
            found.success += usize::from(success != (recorded[0] != 0.0));
        }
        if let Some(recorded) = row(&rollout.reward_sparse, t) {
            let sparse = f64::from(u8::from(success)) - 1.0;
            found.sparse.add(sparse, recorded[0], false);
        }
    }

    fn compare_rules(&mut self, t: usize, before: &[f32], action: &[f64], step: &Step) {
        let recorded = row(&self.replayer.recording.reward, t).map_or(step.reward, |r| r[0]);
        let (action, after) = (single(action), single(&self.replayer.observation));
        let score = |rules: &dyn Rules, errors: &mut RulesErrors| {
            let reward = rules.reward(before, &action, &after);
            errors.reward.add(reward.into(), recorded, false);
            let terminated = rules.terminated(&after);
            errors.terminated += usize::from(terminated != step.terminated);
        };
        score(self.start.as_ref(), &mut self.summary.start);
        if let Some(errors) = &mut self.summary.mean {
            score(self.mean.as_ref(), errors);
        }
        let mut completed = after.clone();
        self.start.complete(before, &action, &mut completed);
        for &i in self.start.known() {
            let (found, simulated) = (completed[i].into(), after[i].into());
            self.summary.known.add(found, simulated, true);
        }
    }

    /// Puts what was found where it belongs: steps that touched an approximate shape are apart, but for
    /// the commands, which depend on no shape.
    fn file(&mut self, found: &mut Differences) {
        let commands = std::mem::take(&mut found.ctrl);
        self.summary.differences.ctrl.merge(&commands);
        if self.replayer.env.touched() {
            self.summary.touched += 1;
            self.summary.touched_differences.merge(found);
        } else {
            self.summary.differences.merge(found);
        }
    }
}

/// The task whose rewards a rollout holds. One of a sparse variant may hold those of the dense task, beside
/// `reward_sparse`; only they are positive, and the tasks are the same otherwise.
fn rewarded(rollout: &Recording) -> String {
    let mut rewards = (0..rollout.steps()).filter_map(|t| row(&rollout.reward, t)?.first());
    if rewards.any(|reward| *reward > 0.0) {
        dense(&rollout.env)
    } else {
        rollout.env.clone()
    }
}

fn single(numbers: &[f64]) -> Vec<f32> {
    numbers.iter().map(|x| *x as f32).collect()
}
