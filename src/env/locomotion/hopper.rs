//! Hopper: hop forward without falling.

use std::sync::Arc;

use mujoco_rs::{Data, Model};

use super::forward::{Forward, observe_within_bound};
use super::noise::add_uniform;
use super::task::{block, effort};
use super::{Info, Locomotion, Scene, Stream, Task, Velocity};
use crate::task::{Rules, VelocityReading};

const ALIVE: f64 = 1.0;
const CONTROL_WEIGHT: f64 = 1e-3;
/// The lowest healthy height of the torso, in metres (exclusive).
const MIN_HEIGHT: f64 = 0.7;
/// The largest healthy pitch of the torso, in radians (exclusive).
const MAX_PITCH: f64 = 0.2;
/// Every position from the pitch on and every velocity must stay within this bound (exclusive).
const MAX_STATE: f64 = 100.0;

/// A planar hopper with one leg.
pub struct Hopper {
    dt: f64,
}

impl Locomotion for Hopper {
    const INFO: Info = Info {
        id: "Hopper-v4",
        summary: "a planar hopper with one leg; hop forward without falling",
        scene: Scene::File("hopper.xml"),
        frame_skip: 4,
        max_episode_steps: 1000,
        observation: &[
            block(5, "positions without x: height, pitch, thigh, leg, foot"),
            block(
                6,
                "velocities within +-10: forward, up, pitch, thigh, leg, foot",
            ),
        ],
        reward: "(x after - x before) / dt + 1 - 0.001 |a|^2",
        termination: "unless height > 0.7, |pitch| < 0.2 and all other numbers are within +-100",
        reset: "positions and velocities uniform +-0.005",
        velocity: Velocity::Index(5),
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
            velocity: 5,
            alive: ALIVE as f32,
            control_weight: CONTROL_WEIGHT as f32,
            healthy: |obs| {
                obs[0] > MIN_HEIGHT as f32
                    && obs[1].abs() < MAX_PITCH as f32
                    && obs[1..].iter().all(|x| x.abs() < MAX_STATE as f32)
            },
        }))
    }
}

impl Task for Hopper {
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
        let qpos = data.qpos();
        let mut state = qpos[2..].iter().chain(data.qvel());
        let healthy =
            qpos[1] > MIN_HEIGHT && qpos[2].abs() < MAX_PITCH && state.all(|x| x.abs() < MAX_STATE);
        !healthy
    }
}
