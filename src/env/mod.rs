//! The tasks: a simulator behind [`Env`], and what its designer knows behind [`Rules`].
//!
//! A task with a goal has it at the end of its observation, where rules and policies find it.
//! Nothing here learns and nothing here sees a tensor: observations and actions are plain slices.

mod doubled;
mod hands;
mod locomotion;
mod noise;
mod registry;
mod rules;
mod scene;
mod simulation;
mod task;

use std::sync::Arc;

use mujoco_rs::Model;
use serde::{Deserialize, Serialize};

pub use doubled::{doubled, doubled_rules};
pub use hands::PenInertia;
pub use registry::{
    Made, MakeError, UnknownTask, ids, info, make, make_replay, make_watched, make_with, model,
    rules,
};
pub use rules::{Rules, VelocityReading};
pub use scene::Scene;
pub use task::{Block, Info, Recorded, Velocity};

use crate::random::Stream;

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

/// A task whose state can be written as recordings need it.
pub trait Replay: Env {
    /// Overwrites the state inside an episode. Body positions and forces stay those of the last
    /// step, as they do in the published tasks.
    fn set_state(&mut self, qpos: &[f64], qvel: &[f64]);

    /// Overwrites the accelerations (`nv`) from which the next step's solver starts.
    fn set_warmstart(&mut self, qacc_warmstart: &[f64]);

    /// Lets the state rest under the zero action as a reset does, and begins an episode there.
    fn settle(&mut self, observation: &mut [f64]);

    /// From now on looks in every physics step for what comes near the geoms whose shape only
    /// approximates the published one, by the contacts of `model`: the same scene, but for the distance
    /// from which those geoms list contacts.
    ///
    /// # Errors
    /// If MuJoCo cannot set the second simulation up.
    fn watch(&mut self, model: Arc<Model>) -> mujoco_rs::Result<()>;

    /// Whether something came near such a geom in the last control step (or while settling).
    fn touched(&self) -> bool;

    /// What recordings leave open of this task's state.
    fn recorded(&self) -> Recorded;

    /// What the goal would have to be to be reached in this state, `goal_size`.
    fn achieved_goal(&self) -> Vec<f64>;

    /// Positions to draw the scene at, `nq`: those of the state, with targets where the goal is.
    fn shown_qpos(&self) -> Vec<f64>;

    /// How far `goal` lies from the goals that a reset can draw: for objects that settled at `qpos`, or,
    /// unless these have `settled`, for objects anywhere.
    fn goal_error(&self, qpos: &[f64], goal: &[f64], settled: bool) -> f64;

    /// Simulated seconds that pass in a reset.
    fn settling_time(&self) -> f64;

    /// Positions, `nq`.
    fn qpos(&self) -> &[f64];

    /// Velocities, `nv`.
    fn qvel(&self) -> &[f64];

    /// Command of the actuators in the last step, `nu`.
    fn ctrl(&self) -> &[f64];
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
    /// Every action number lies in `[-action_limit, action_limit]`.
    pub action_limit: f64,
    /// Control steps until an episode is truncated.
    pub max_episode_steps: usize,
    /// Seconds of simulated time a control step.
    pub dt: f64,
    /// Positions of a simulated state.
    pub nq: usize,
    /// Velocities of a simulated state.
    pub nv: usize,
}
