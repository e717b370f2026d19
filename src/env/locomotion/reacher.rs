//! Reacher: bring the fingertip to the target.

use std::f64::consts::TAU;
use std::sync::Arc;

use mujoco_rs::{Data, Model, Object};

use super::forward::effort as effort_f32;
use super::noise::{add_uniform, uniform};
use super::task::{block, body_position, effort, write};
use super::{Info, Locomotion, Scene, Stream, Task, Velocity};
use crate::task::{Rules, VelocityReading};

/// Targets are drawn from the disc of this radius, in metres.
const REACH: f64 = 0.2;

/// A planar arm of two links.
pub struct Reacher {
    fingertip: usize,
    target: usize,
}

impl Locomotion for Reacher {
    const INFO: Info = Info {
        id: "Reacher-v4",
        summary: "a planar arm of two links; bring the fingertip to the target",
        scene: Scene::File("reacher.xml"),
        frame_skip: 2,
        max_episode_steps: 50,
        observation: &[
            block(2, "cosines of the two joint angles"),
            block(2, "sines of the two joint angles"),
            block(2, "position of the target"),
            block(2, "velocities of the two joints"),
            block(3, "fingertip minus target"),
        ],
        reward: "-|fingertip - target| - |a|^2, the distance taken before the action",
        termination: "never",
        reset: "joint angles uniform +-0.1, their velocities uniform +-0.005, target uniform in \
                the disc of radius 0.2",
        velocity: Velocity::None,
        drops: false,
        relative: false,
    };

    fn new(model: &Model) -> mujoco_rs::Result<Self> {
        Ok(Self {
            fingertip: model.id(Object::Body, "fingertip")?,
            target: model.id(Object::Body, "target")?,
        })
    }

    fn rules(_: &Model, _: VelocityReading) -> mujoco_rs::Result<Arc<dyn Rules>> {
        Ok(Arc::new(Reach))
    }
}

impl Task for Reacher {
    /// Fingertip minus target.
    type Carried = [f64; 3];

    fn start(&self, rng: &mut Stream, qpos: &mut [f64], qvel: &mut [f64]) {
        add_uniform(rng, 0.1, &mut qpos[..2]);
        add_uniform(rng, 0.005, &mut qvel[..2]);
        // Uniform in the disc without rejection: the number of draws stays the same.
        let (radius, angle) = (
            REACH * uniform(rng, 0.0, 1.0).sqrt(),
            uniform(rng, 0.0, TAU),
        );
        qpos[2] = radius * angle.cos();
        qpos[3] = radius * angle.sin();
    }

    fn carry(&self, data: &Data) -> [f64; 3] {
        let tip = body_position(data, self.fingertip);
        let target = body_position(data, self.target);
        [0, 1, 2].map(|i| tip[i] - target[i])
    }

    fn observe(&self, data: &Data, observation: &mut [f64]) {
        let (qpos, qvel) = (data.qpos(), data.qvel());
        let cosines = qpos[..2].iter().map(|q| q.cos());
        let sines = qpos[..2].iter().map(|q| q.sin());
        let rest = qpos[2..].iter().chain(&qvel[..2]).copied();
        write(
            observation,
            cosines.chain(sines).chain(rest).chain(self.carry(data)),
        );
    }

    fn reward(&self, before: &[f64; 3], _: &[f64; 3], _: &Data, action: &[f64]) -> f64 {
        -before.iter().map(|x| x * x).sum::<f64>().sqrt() - effort(action)
    }
}

/// The distance of the reward is in the observation before the step, so the rule is exact.
struct Reach;

impl Rules for Reach {
    fn reward(&self, obs: &[f32], action: &[f32], _: &[f32]) -> f32 {
        -obs[8..].iter().map(|x| x * x).sum::<f32>().sqrt() - effort_f32(action)
    }

    fn terminated(&self, _: &[f32]) -> bool {
        false
    }

    /// The target stays where it is, and everything stays in its plane.
    fn known(&self) -> &[usize] {
        &[4, 5, 10]
    }

    fn complete(&self, obs: &[f32], _: &[f32], next_obs: &mut [f32]) {
        for &i in self.known() {
            next_obs[i] = obs[i];
        }
    }
}
