//! The tasks: a simulator behind [`Env`], and what its designer knows behind [`Rules`].
//!
//! Nothing here learns and nothing here sees a tensor: observations and actions are plain slices.

mod locomotion;
mod noise;
mod registry;
mod rules;
mod scene;
mod simulation;
mod task;

use serde::{Deserialize, Serialize};

pub use registry::{
    Made, MakeError, UnknownTask, ids, info, make, make_replay, make_with, model, rules,
};
pub use rules::{Rules, VelocityReading};
pub use task::{Block, Info, Velocity};

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
}

/// A simulated task: an episode is one `reset` and then `step`s until one of them reports
/// `terminated` or `truncated`.
pub trait Env: Send {
    /// Sizes, ranges and limits of the task.
    fn spec(&self) -> &Spec;

    /// Starts a new episode from `rng` and writes its first observation (`spec().obs_size` numbers).
    fn reset(&mut self, rng: &mut Stream, observation: &mut [f64]);

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
    /// Starts an episode in the given state (`nq` and `nv` numbers): everything else is cleared, then
    /// everything that depends on the state is computed and the observation written.
    fn start_at(&mut self, qpos: &[f64], qvel: &[f64], observation: &mut [f64]);

    /// Overwrites the state inside an episode. Body positions and forces stay those of the last
    /// step, as they do in the published tasks.
    fn set_state(&mut self, qpos: &[f64], qvel: &[f64]);

    /// Overwrites the accelerations (`nv`) from which the next step's solver starts.
    fn set_warmstart(&mut self, qacc_warmstart: &[f64]);

    /// Positions, `nq`.
    fn qpos(&self) -> &[f64];

    /// Velocities, `nv`.
    fn qvel(&self) -> &[f64];
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
    /// Length of an observation.
    pub obs_size: usize,
    /// Length of an action.
    pub action_size: usize,
    /// Every action number lies in `[-action_limit, action_limit]`.
    pub action_limit: f64,
    /// Control steps until an episode is truncated.
    pub max_episode_steps: usize,
    /// Seconds of simulated time a control step.
    pub dt: f64,
}
