//! Walker2d: walk forward without falling.

use std::sync::Arc;

use mujoco_rs::{Data, Model};

use super::forward::{Forward, observe_within_bound};
use super::noise::add_uniform;
use super::task::{block, effort};
use super::{Info, Locomotion, Scene, Stream, Task, Velocity};
use crate::task::{Rules, VelocityReading};

const ALIVE: f64 = 1.0;
const CONTROL_WEIGHT: f64 = 1e-3;
/// Healthy heights of the torso, in metres (exclusive).
const HEIGHT: (f64, f64) = (0.8, 2.0);
/// The largest healthy pitch of the torso, in radians (exclusive).
const MAX_PITCH: f64 = 1.0;

/// A planar biped.
pub struct Walker2d {
    dt: f64,
}

impl Locomotion for Walker2d {
    const INFO: Info = Info {
        id: "Walker2d-v4",
        summary: "a planar biped; walk forward without falling",
        scene: Scene::File("walker2d.xml"),
        frame_skip: 4,
        max_episode_steps: 1000,
        observation: &[
            block(
                8,
                "positions without x: height, pitch, right and left thigh, leg, foot",
            ),
            block(
                9,
                "velocities within +-10: forward, up, pitch, then the six joints",
            ),
        ],
        reward: "(x after - x before) / dt + 1 - 0.001 |a|^2",
        termination: "unless 0.8 < height < 2 and |pitch| < 1",
        reset: "positions and velocities uniform +-0.005",
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
            alive: ALIVE as f32,
            control_weight: CONTROL_WEIGHT as f32,
            healthy: |obs| healthy(obs[0].into(), obs[1].into()),
        }))
    }
}

impl Task for Walker2d {
    /// x of the root.
    type Carried = [f64; 1];

    fn start(&self, rng: &mut Stream, qpos: &mut [f64], qvel: &mut [f64]) {
        add_uniform(rng, 0.005, qpos);
        add_uniform(rng, 0.005, qvel);
    }

    fn carry(&self, data: &Data) -> [f64; 1] {
        [data.qpos()[0]]
    }

    fn observe(&self, data: &Data, observation: &mut [f64]) {
        observe_within_bound(data, observation);
    }

    fn reward(&self, before: &[f64; 1], after: &[f64; 1], _: &Data, action: &[f64]) -> f64 {
        (after[0] - before[0]) / self.dt + ALIVE - CONTROL_WEIGHT * effort(action)
    }

    fn terminated(&self, data: &Data) -> bool {
        !healthy(data.qpos()[1], data.qpos()[2])
    }
}

fn healthy(height: f64, pitch: f64) -> bool {
    HEIGHT.0 < height && height < HEIGHT.1 && pitch.abs() < MAX_PITCH
}
