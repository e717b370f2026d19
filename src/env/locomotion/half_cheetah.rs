//! HalfCheetah: run forward; never ends.

use std::sync::Arc;

use mujoco_rs::{Data, Model};

use super::forward::Forward;
use super::noise::{add_normal, add_uniform};
use super::task::{block, effort, write};
use super::{Info, Locomotion, Scene, Stream, Task, Velocity};
use crate::task::{Rules, VelocityReading};

const CONTROL_WEIGHT: f64 = 0.1;

/// A planar runner with two legs.
pub struct HalfCheetah {
    dt: f64,
}

impl Locomotion for HalfCheetah {
    const INFO: Info = Info {
        id: "HalfCheetah-v4",
        summary: "a planar runner with two legs; run forward",
        scene: Scene::File("half_cheetah.xml"),
        frame_skip: 5,
        max_episode_steps: 1000,
        observation: &[
            block(
                8,
                "positions without x: height, pitch, back and front thigh, shin, foot",
            ),
            block(9, "velocities: forward, up, pitch, then the six joints"),
        ],
        reward: "(x after - x before) / dt - 0.1 |a|^2",
        termination: "never",
        reset: "positions uniform +-0.1, velocities normal with deviation 0.1",
        velocity: Velocity::Index(8),
        drops: false,
        relative: false,
    };

    fn new(model: &Model) -> mujoco_rs::Result<Self> {
        Ok(Self {
            dt: super::dt::<Self>(model),
        })
    }

    fn rules(_: &Model, reading: VelocityReading) -> mujoco_rs::Result<Arc<dyn Rules>> {
        Ok(Arc::new(Forward {
            reading,
            velocity: 8,
            alive: 0.0,
            control_weight: CONTROL_WEIGHT as f32,
            healthy: |_| true,
        }))
    }
}

impl Task for HalfCheetah {
    /// x of the root.
    type Carried = [f64; 1];

    fn start(&self, rng: &mut Stream, qpos: &mut [f64], qvel: &mut [f64]) {
        add_uniform(rng, 0.1, qpos);
        add_normal(rng, 0.1, qvel);
    }

    fn carry(&self, data: &Data) -> [f64; 1] {
        [data.qpos()[0]]
    }

    fn observe(&self, data: &Data, observation: &mut [f64]) {
        let (positions, velocities) = (&data.qpos()[1..], data.qvel());
        write(observation, positions.iter().chain(velocities).copied());
    }

    fn reward(&self, before: &[f64; 1], after: &[f64; 1], _: &Data, action: &[f64]) -> f64 {
        (after[0] - before[0]) / self.dt - CONTROL_WEIGHT * effort(action)
    }
}
