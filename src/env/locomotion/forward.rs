//! What the tasks share that reward moving forward.

use mujoco_rs::Data;

use super::task::write;
use crate::task::{Rules, VelocityReading};

/// `reward = v + alive - control_weight * |a|^2`, with the forward velocity v read from the
/// observations on both sides of the step (the simulator uses a difference quotient of positions,
/// which observations leave out).
pub struct Forward {
    /// Which observation v is read from.
    pub reading: VelocityReading,
    /// Index of v in an observation.
    pub velocity: usize,
    /// What every step earns.
    pub alive: f32,
    /// Cost of the action's sum of squares.
    pub control_weight: f32,
    /// Whether the task goes on in a state with this observation.
    pub healthy: fn(&[f32]) -> bool,
}

impl Rules for Forward {
    fn reward(&self, obs: &[f32], action: &[f32], next_obs: &[f32]) -> f32 {
        let v = self.reading.of(obs[self.velocity], next_obs[self.velocity]);
        v + self.alive - self.control_weight * effort(action)
    }

    fn terminated(&self, next_obs: &[f32]) -> bool {
        !(self.healthy)(next_obs)
    }
}

/// Sum of squares of an action's numbers.
pub fn effort(action: &[f32]) -> f32 {
    action.iter().map(|a| a * a).sum()
}

/// Velocities of Hopper and Walker2d are observed within this bound.
const MAX_VELOCITY: f64 = 10.0;

/// Positions without x, then velocities within +-10.
pub fn observe_within_bound(data: &Data, observation: &mut [f64]) {
    let positions = data.qpos()[1..].iter().copied();
    let bounded = |v: &f64| v.clamp(-MAX_VELOCITY, MAX_VELOCITY);
    write(
        observation,
        positions.chain(data.qvel().iter().map(bounded)),
    );
}
