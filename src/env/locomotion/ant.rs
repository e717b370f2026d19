//! Ant: run forward without jumping or falling.

use std::sync::Arc;

use mujoco_rs::{Data, Model, Object};

use super::forward::Forward;
use super::noise::{add_normal, add_uniform};
use super::task::{block, body_position, effort, write};
use super::{Info, Locomotion, Scene, Stream, Task, Velocity};
use crate::task::{Rules, VelocityReading};

const ALIVE: f64 = 1.0;
const CONTROL_WEIGHT: f64 = 0.5;
/// Healthy heights of the torso, in metres (inclusive).
const HEIGHT: (f64, f64) = (0.2, 1.0);

/// A ball on four legs.
pub struct Ant {
    torso: usize,
    dt: f64,
}

impl Locomotion for Ant {
    const INFO: Info = Info {
        id: "Ant-v4",
        summary: "a ball on four legs; run forward without jumping or falling",
        scene: Scene::File("ant.xml"),
        frame_skip: 5,
        max_episode_steps: 1000,
        observation: &[
            block(1, "height of the torso"),
            block(4, "orientation of the torso, a quaternion (w, x, y, z)"),
            block(8, "angles of hip and ankle of legs 1 to 4"),
            block(3, "linear velocity of the torso in the world"),
            block(3, "angular velocity of the torso in its own frame"),
            block(8, "angular velocities of hip and ankle of legs 1 to 4"),
        ],
        reward: "(x after - x before) / dt of the torso + 1 - 0.5 |a|^2",
        termination: "when height is outside [0.2, 1] or a number is not finite",
        reset: "positions uniform +-0.1 (quaternion included), velocities normal with deviation 0.1",
        velocity: Velocity::Index(13),
        drops: false,
        relative: false,
    };

    fn new(model: &Model) -> mujoco_rs::Result<Self> {
        Ok(Self {
            torso: model.id(Object::Body, "torso")?,
            dt: super::dt::<Self>(model),
        })
    }

    fn rules(_: &Model, reading: VelocityReading) -> mujoco_rs::Result<Arc<dyn Rules>> {
        Ok(Arc::new(Forward {
            reading,
            velocity: 13,
            alive: ALIVE as f32,
            control_weight: CONTROL_WEIGHT as f32,
            healthy: |obs| {
                (HEIGHT.0 as f32..=HEIGHT.1 as f32).contains(&obs[0])
                    && obs.iter().all(|x| x.is_finite())
            },
        }))
    }
}

impl Task for Ant {
    /// x of the torso's body, which lags one physics step behind the root's position.
    type Carried = [f64; 1];

    fn start(&self, rng: &mut Stream, qpos: &mut [f64], qvel: &mut [f64]) {
        add_uniform(rng, 0.1, qpos);
        add_normal(rng, 0.1, qvel);
    }

    fn carry(&self, data: &Data) -> [f64; 1] {
        [body_position(data, self.torso)[0]]
    }

    fn observe(&self, data: &Data, observation: &mut [f64]) {
        let (positions, velocities) = (&data.qpos()[2..], data.qvel());
        write(observation, positions.iter().chain(velocities).copied());
    }

    fn reward(&self, before: &[f64; 1], after: &[f64; 1], _: &Data, action: &[f64]) -> f64 {
        (after[0] - before[0]) / self.dt + ALIVE - CONTROL_WEIGHT * effort(action)
    }

    fn terminated(&self, data: &Data) -> bool {
        let mut state = data.qpos().iter().chain(data.qvel());
        let healthy =
            (HEIGHT.0..=HEIGHT.1).contains(&data.qpos()[2]) && state.all(|x| x.is_finite());
        !healthy
    }
}
