//! InvertedPendulum: keep the pole up.

use std::sync::Arc;

use mujoco_rs::{Data, Model};

use super::noise::add_uniform;
use super::task::{block, write};
use super::{Info, Locomotion, Scene, Stream, Task, Velocity};
use crate::task::{Rules, VelocityReading};

/// The largest angle of the pole, in radians, at which the task goes on.
const MAX_ANGLE: f64 = 0.2;

/// A pole on a cart.
pub struct InvertedPendulum;

impl Locomotion for InvertedPendulum {
    const INFO: Info = Info {
        id: "InvertedPendulum-v4",
        summary: "a pole on a cart; keep it up",
        scene: Scene::File("inverted_pendulum.xml"),
        frame_skip: 2,
        max_episode_steps: 1000,
        observation: &[
            block(2, "position of the cart, angle of the pole"),
            block(2, "their velocities"),
        ],
        reward: "1",
        termination: "when |angle| > 0.2 or a number is not finite",
        reset: "positions and velocities uniform +-0.01",
        velocity: Velocity::None,
        drops: false,
        relative: false,
    };

    fn new(_: &Model) -> mujoco_rs::Result<Self> {
        Ok(Self)
    }

    fn rules(_: &Model, _: VelocityReading) -> mujoco_rs::Result<Arc<dyn Rules>> {
        Ok(Arc::new(Upright))
    }
}

impl Task for InvertedPendulum {
    type Carried = [f64; 0];

    fn start(&self, rng: &mut Stream, qpos: &mut [f64], qvel: &mut [f64]) {
        add_uniform(rng, 0.01, qpos);
        add_uniform(rng, 0.01, qvel);
    }

    fn carry(&self, _: &Data) -> [f64; 0] {
        []
    }

    fn observe(&self, data: &Data, observation: &mut [f64]) {
        write(observation, data.qpos().iter().chain(data.qvel()).copied());
    }

    fn reward(&self, _: &[f64; 0], _: &[f64; 0], _: &Data, _: &[f64]) -> f64 {
        1.0
    }

    fn terminated(&self, data: &Data) -> bool {
        let mut numbers = data.qpos().iter().chain(data.qvel());
        data.qpos()[1].abs() > MAX_ANGLE || numbers.any(|x| !x.is_finite())
    }
}

struct Upright;

impl Rules for Upright {
    fn reward(&self, _: &[f32], _: &[f32], _: &[f32]) -> f32 {
        1.0
    }

    fn terminated(&self, next_obs: &[f32]) -> bool {
        next_obs[1].abs() > MAX_ANGLE as f32 || next_obs.iter().any(|x| !x.is_finite())
    }
}
