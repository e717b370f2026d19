//! Pusher: push the puck onto the goal.

use std::sync::Arc;

use mujoco_rs::{Data, Model, Object};

use super::forward::effort as effort_f32;
use super::noise::{add_uniform, uniform};
use super::task::{block, body_position, distance, effort, write};
use super::{Info, Locomotion, Scene, Stream, Task, Velocity};
use crate::task::{Rules, VelocityReading};

const NEAR_WEIGHT: f64 = 0.5;
const CONTROL_WEIGHT: f64 = 0.1;
/// The puck begins farther from the goal than this, in metres.
const MIN_DISTANCE: f64 = 0.17;

/// An arm of seven joints over a table.
pub struct Pusher {
    tip: usize,
    object: usize,
    goal: usize,
}

impl Locomotion for Pusher {
    const INFO: Info = Info {
        id: "Pusher-v4",
        summary: "an arm of seven joints; push the puck onto the goal",
        scene: Scene::File("pusher.xml"),
        frame_skip: 5,
        max_episode_steps: 100,
        observation: &[
            block(7, "angles of the arm"),
            block(7, "velocities of the arm"),
            block(3, "position of the tip"),
            block(3, "position of the puck"),
            block(3, "position of the goal"),
        ],
        reward: "-|puck - goal| - 0.5 |puck - tip| - 0.1 |a|^2, the distances taken before the \
                 action",
        termination: "never",
        reset: "arm at rest with velocities uniform +-0.005; the puck's shift from the goal uniform \
                in [-0.3, 0] x [-0.2, 0.2] outside the disc of radius 0.17",
        velocity: Velocity::None,
        drops: false,
        relative: false,
    };

    fn new(model: &Model) -> mujoco_rs::Result<Self> {
        Ok(Self {
            tip: model.id(Object::Body, "tips_arm")?,
            object: model.id(Object::Body, "object")?,
            goal: model.id(Object::Body, "goal")?,
        })
    }

    fn rules(_: &Model, _: VelocityReading) -> mujoco_rs::Result<Arc<dyn Rules>> {
        Ok(Arc::new(Push))
    }
}

impl Task for Pusher {
    /// Distances of the puck from the tip and from the goal.
    type Carried = [f64; 2];

    fn start(&self, rng: &mut Stream, qpos: &mut [f64], qvel: &mut [f64]) {
        let shift = loop {
            let shift = [uniform(rng, -0.3, 0.0), uniform(rng, -0.2, 0.2)];
            if shift[0].hypot(shift[1]) > MIN_DISTANCE {
                break shift;
            }
        };
        qpos[7..9].copy_from_slice(&shift);
        add_uniform(rng, 0.005, &mut qvel[..7]);
    }

    fn carry(&self, data: &Data) -> [f64; 2] {
        let at = |id| body_position(data, id);
        let object = at(self.object);
        [
            distance(object, at(self.tip)),
            distance(object, at(self.goal)),
        ]
    }

    fn observe(&self, data: &Data, observation: &mut [f64]) {
        let arm = data.qpos()[..7].iter().chain(&data.qvel()[..7]).copied();
        let bodies = [self.tip, self.object, self.goal];
        let positions = bodies.into_iter().flat_map(|id| body_position(data, id));
        write(observation, arm.chain(positions));
    }

    fn reward(&self, before: &[f64; 2], _: &[f64; 2], _: &Data, action: &[f64]) -> f64 {
        let [to_tip, to_goal] = before;
        -to_goal - NEAR_WEIGHT * to_tip - CONTROL_WEIGHT * effort(action)
    }
}

/// The distances of the reward are in the observation before the step, so the rule is exact.
struct Push;

impl Rules for Push {
    fn reward(&self, obs: &[f32], action: &[f32], _: &[f32]) -> f32 {
        let (tip, object, goal) = (&obs[14..17], &obs[17..20], &obs[20..23]);
        let distance = |a: &[f32], b: &[f32]| {
            let squares = a.iter().zip(b).map(|(a, b)| (a - b) * (a - b));
            squares.sum::<f32>().sqrt()
        };
        let near = NEAR_WEIGHT as f32 * distance(object, tip);
        -distance(object, goal) - near - CONTROL_WEIGHT as f32 * effort_f32(action)
    }

    fn terminated(&self, _: &[f32]) -> bool {
        false
    }

    /// The goal stays where it is, and the puck slides in its plane.
    fn known(&self) -> &[usize] {
        &[19, 20, 21, 22]
    }

    fn complete(&self, obs: &[f32], _: &[f32], next_obs: &mut [f32]) {
        next_obs[19..].copy_from_slice(&obs[19..]);
    }
}
