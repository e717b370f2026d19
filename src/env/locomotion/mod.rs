//! The locomotion tasks, version 4: figures and rules as published with gymnasium 0.29.1.

mod ant;
mod forward;
mod half_cheetah;
mod hopper;
mod humanoid;
mod humanoid_standup;
mod inverted_double_pendulum;
mod inverted_pendulum;
mod pusher;
mod reacher;
mod swimmer;
mod walker2d;

pub use ant::Ant;
pub use half_cheetah::HalfCheetah;
pub use hopper::Hopper;
pub use humanoid::Humanoid;
pub use humanoid_standup::HumanoidStandup;
pub use inverted_double_pendulum::InvertedDoublePendulum;
pub use inverted_pendulum::InvertedPendulum;
pub use pusher::Pusher;
pub use reacher::Reacher;
pub use swimmer::Swimmer;
pub use walker2d::Walker2d;

use std::sync::Arc;

use mujoco_rs::Model;

use super::noise;
use super::scene::Scene;
use super::task::{self, Info, Task, Velocity};
use crate::core::random::Stream;
use crate::task::{Rules, VelocityReading};

/// What the registry needs of a task that is described by one file: a task file implements this and
/// [`Task`], and nothing else.
pub trait Locomotion: Task + Sized + 'static {
    /// The task's constants.
    const INFO: Info;

    /// Looks up whatever ids the task needs.
    ///
    /// # Errors
    /// If the model lacks an object the task reads.
    fn new(model: &Model) -> mujoco_rs::Result<Self>;

    /// The task's rules on observations.
    ///
    /// # Errors
    /// If the model lacks an object the rules read.
    fn rules(model: &Model, reading: VelocityReading) -> mujoco_rs::Result<Arc<dyn Rules>>;
}

/// Seconds of a control step.
fn dt<T: Locomotion>(model: &Model) -> f64 {
    model.timestep() * T::INFO.frame_skip as f64
}
