//! What a task is, without a simulator: sizes and ranges, steps, what its designer knows. No MuJoCo here.
//!
//! A task with a goal has it at the end of its observation, where rules and policies find it. Observations and
//! actions are plain slices.

mod rules;

pub use rules::{Rules, VelocityReading};

use crate::core::random::Stream;
use crate::core::span::Span;
use serde::{Deserialize, Serialize};

/// What one call of [`Env::step`] brings besides the observation.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Step {
    /// Reward of the step.
    pub reward: f64,
    /// The task really ended here: nothing follows, the bootstrap is cut.
    pub terminated: bool,
    /// The episode is cut here by its time limit or by a diverged simulation; the task itself
    /// goes on, so the bootstrap is not cut.
    pub truncated: bool,
    /// The simulation blew up (MuJoCo's bad-state warnings, or a number that is not finite). The
    /// observation must not be stored; `truncated` is true as well.
    pub diverged: bool,
    /// A buffer of the simulator was full, so that contacts or constraints were left out of the physics.
    pub buffer_full: bool,
    /// An object lies out of reach of the hands, so that nothing is to be had from here on. It ends no episode.
    pub dropped: bool,
    /// Whether the goal is reached now; `None` for a task that knows no success. Success does not end
    /// an episode.
    pub success: Option<bool>,
}

/// A simulated task: an episode is one `reset` and then `step`s until one of them reports
/// `terminated` or `truncated`.
pub trait Env: Send {
    /// Sizes, ranges and limits of the task.
    fn spec(&self) -> &Spec;

    /// Starts a new episode from `rng` and writes its first observation (`spec().obs_size` numbers).
    fn reset(&mut self, rng: &mut Stream, observation: &mut [f64]);

    /// Starts a new episode in a given state and writes its first observation.
    fn start_at(&mut self, start: &Start<'_>, observation: &mut [f64]);

    /// Draws a goal (`spec().goal_size` numbers) as [`reset`](Env::reset) would for objects that
    /// settled at the positions `qpos`.
    fn draw_goal(&self, rng: &mut Stream, qpos: &[f64]) -> Vec<f64>;

    /// Applies `action` (`spec().action_size` numbers) for one control step and writes the
    /// observation that follows.
    fn step(&mut self, action: &[f64], observation: &mut [f64]) -> Step;

    /// Everything that the rest of the episode depends on.
    fn snapshot(&self) -> EnvState;

    /// Goes on where `state` was taken: the steps that follow are equal to the last bit, on this or
    /// any other instance of the task. The observation of the state is not part of it.
    ///
    /// # Errors
    /// If the state belongs to another task; the simulation is then as before.
    fn restore(&mut self, state: &EnvState) -> Result<(), StateMismatch>;
}

/// A state in which an episode is to begin. Everything that is not given is cleared.
#[derive(Debug, Clone, Copy)]
pub struct Start<'a> {
    /// Positions, `nq`.
    pub qpos: &'a [f64],
    /// Velocities, `nv`.
    pub qvel: &'a [f64],
    /// The action executed before: its command is the one the state was reached under.
    pub previous_action: Option<&'a [f64]>,
    /// The goal, `goal_size`.
    pub goal: &'a [f64],
}

/// A state of a task to the last bit, to be written into checkpoints.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct EnvState {
    /// Simulated seconds since the reset.
    pub time: f64,
    /// Positions, `nq`.
    pub qpos: Vec<f64>,
    /// Velocities, `nv`.
    pub qvel: Vec<f64>,
    /// Actuator activations, `na`.
    pub act: Vec<f64>,
    /// Last command, `nu`.
    pub ctrl: Vec<f64>,
    /// Accelerations from which the solver starts, `nv`.
    pub qacc_warmstart: Vec<f64>,
    /// Figures of this state that the next step's reward needs and that cannot be computed again,
    /// because the tasks read them one physics step late.
    pub carried: Vec<f64>,
    /// Goal of the episode.
    pub goal: Vec<f64>,
    /// Control steps since the reset.
    pub elapsed_steps: usize,
}

/// A state that does not fit the task it is to be restored into.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("the saved state does not belong to {id}: {part} has {found} numbers, not {expected}")]
pub struct StateMismatch {
    /// The task.
    pub id: String,
    /// The part that differs.
    pub part: &'static str,
    /// Its length in this task.
    pub expected: usize,
    /// Its length in the saved state.
    pub found: usize,
}

/// The constant facts of a task.
#[derive(Debug, Clone, PartialEq)]
pub struct Spec {
    /// Registered id, for example `HalfCheetah-v4`.
    pub id: String,
    /// Length of an observation, the goal at its end included.
    pub obs_size: usize,
    /// Length of the goal at the end of an observation; 0 for a task without one.
    pub goal_size: usize,
    /// Length of an action.
    pub action_size: usize,
    /// Where each number of an action lies, `action_size` ranges. An action before the first one is 0.
    pub action_ranges: Vec<Span>,
    /// Control steps until an episode is truncated.
    pub max_episode_steps: usize,
    /// Seconds of simulated time a control step.
    pub dt: f64,
    /// Positions of a simulated state.
    pub nq: usize,
    /// Velocities of a simulated state.
    pub nv: usize,
}

/// The id of a task without the mark of its sparse variant: `PenSparse-v0` becomes `Pen-v0`.
pub fn dense(task: &str) -> String {
    match task.rsplit_once("-v") {
        Some((name, version)) => {
            let name = name.strip_suffix("Sparse").unwrap_or(name);
            format!("{name}-v{version}")
        }
        None => task.to_owned(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_sparse_variant_is_the_same_task() {
        assert_eq!(dense("EggHandOverSparse-v0"), dense("EggHandOver-v0"));
        assert_ne!(dense("EggHandOver-v1"), dense("EggHandOver-v0"));
        assert_ne!(dense("PenSpin-v0"), dense("EggHandOver-v0"));
        assert_eq!(dense("unversioned"), "unversioned");
    }
}
