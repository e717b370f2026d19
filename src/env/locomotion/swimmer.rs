//! Swimmer: swim forward; never ends.

use std::sync::Arc;

use mujoco_rs::{Data, Model};

use super::forward::Forward;
use super::noise::add_uniform;
use super::task::{block, effort, write};
use super::{Info, Locomotion, Scene, Stream, Task, Velocity};
use crate::task::{Rules, VelocityReading};

const CONTROL_WEIGHT: f64 = 1e-4;

/// A chain of three links in a thick fluid.
pub struct Swimmer {
    dt: f64,
}

impl Locomotion for Swimmer {
    const INFO: Info = Info {
        id: "Swimmer-v4",
        summary: "a chain of three links in a thick fluid; swim forward",
        scene: Scene::File("swimmer.xml"),
        frame_skip: 4,
        max_episode_steps: 1000,
        observation: &[
            block(3, "positions without x and y: heading, the two joints"),
            block(5, "velocities: x, y, heading, the two joints"),
        ],
        reward: "(x after - x before) / dt - 0.0001 |a|^2",
        termination: "never",
        reset: "positions and velocities uniform +-0.1",
        velocity: Velocity::Index(3),
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
            velocity: 3,
            alive: 0.0,
            control_weight: CONTROL_WEIGHT as f32,
            healthy: |_| true,
        }))
    }
}

impl Task for Swimmer {
    /// x of the front tip's frame.
    type Carried = [f64; 1];

    fn start(&self, rng: &mut Stream, qpos: &mut [f64], qvel: &mut [f64]) {
        add_uniform(rng, 0.1, qpos);
        add_uniform(rng, 0.1, qvel);
    }

    fn carry(&self, data: &Data) -> [f64; 1] {
        [data.qpos()[0]]
    }

    fn observe(&self, data: &Data, observation: &mut [f64]) {
        let (positions, velocities) = (&data.qpos()[2..], data.qvel());
        write(observation, positions.iter().chain(velocities).copied());
    }

    fn reward(&self, before: &[f64; 1], after: &[f64; 1], _: &Data, action: &[f64]) -> f64 {
        (after[0] - before[0]) / self.dt - CONTROL_WEIGHT * effort(action)
    }
}
