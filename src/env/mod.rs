//! The tasks: a simulator behind [`Env`], and what its designer knows behind [`Rules`].
//!
//! Nothing here learns and nothing here sees a tensor: observations and actions are plain slices.

mod rules;

pub use rules::{Rules, VelocityReading};

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
