//! What recordings and pictures need of a simulated task beyond [`Env`].

use super::Recorded;
use crate::task::Env;
use mujoco_rs::Model;
use std::sync::Arc;

/// A task whose state can be written as recordings need it.
pub trait Inspect: Env {
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
