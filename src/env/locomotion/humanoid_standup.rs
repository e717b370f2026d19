//! HumanoidStandup: get up from the floor; never ends.

use std::sync::Arc;

use mujoco_rs::{Data, Model};

use super::forward::effort as effort_f32;
use super::humanoid::{CONTACT, Constant, OBSERVATION, observe};
use super::noise::add_uniform;
use super::task::effort;
use super::{Info, Locomotion, Scene, Stream, Task, Velocity};
use crate::task::{Rules, VelocityReading};

const ALIVE: f64 = 1.0;
const CONTROL_WEIGHT: f64 = 0.1;
const IMPACT_WEIGHT: f64 = 5e-7;
const MAX_IMPACT_COST: f64 = 10.0;

/// A walker with arms, lying on its back.
pub struct HumanoidStandup {
    timestep: f64,
}

impl Locomotion for HumanoidStandup {
    const INFO: Info = Info {
        id: "HumanoidStandup-v4",
        summary: "a walker with arms lying on its back; get up",
        scene: Scene::File("humanoid_standup.xml"),
        frame_skip: 5,
        max_episode_steps: 1000,
        observation: OBSERVATION,
        reward: "height / 0.003 + 1 - 0.1 |a|^2 - min(10, 5e-7 |external forces|^2)",
        termination: "never",
        reset: "positions (quaternion included) and velocities uniform +-0.01",
        velocity: Velocity::None,
        drops: false,
        relative: true,
    };

    fn new(model: &Model) -> mujoco_rs::Result<Self> {
        Ok(Self {
            timestep: model.timestep(),
        })
    }

    fn rules(model: &Model, _: VelocityReading) -> mujoco_rs::Result<Arc<dyn Rules>> {
        Ok(Arc::new(GetUp {
            timestep: model.timestep() as f32,
            constant: Constant::new(model),
        }))
    }
}

impl Task for HumanoidStandup {
    type Carried = [f64; 0];

    const CONTACT_FORCES: bool = true;

    fn start(&self, rng: &mut Stream, qpos: &mut [f64], qvel: &mut [f64]) {
        add_uniform(rng, 0.01, qpos);
        add_uniform(rng, 0.01, qvel);
    }

    fn carry(&self, _: &Data) -> [f64; 0] {
        []
    }

    fn observe(&self, data: &Data, observation: &mut [f64]) {
        observe(data, observation);
    }

    fn reward(&self, _: &[f64; 0], _: &[f64; 0], data: &Data, action: &[f64]) -> f64 {
        let impact = IMPACT_WEIGHT * effort(data.cfrc_ext());
        let cost = CONTROL_WEIGHT * effort(action) + impact.min(MAX_IMPACT_COST);
        data.qpos()[2] / self.timestep + ALIVE - cost
    }
}

/// Everything the reward reads is in the observation after the step, so the rule is exact.
struct GetUp {
    timestep: f32,
    constant: Constant,
}

impl Rules for GetUp {
    fn reward(&self, _: &[f32], action: &[f32], next_obs: &[f32]) -> f32 {
        let impact = IMPACT_WEIGHT as f32 * effort_f32(&next_obs[CONTACT..]);
        let cost = CONTROL_WEIGHT as f32 * effort_f32(action) + impact.min(MAX_IMPACT_COST as f32);
        next_obs[0] / self.timestep + ALIVE as f32 - cost
    }

    fn terminated(&self, _: &[f32]) -> bool {
        false
    }

    fn known(&self) -> &[usize] {
        &self.constant.known
    }

    fn complete(&self, _: &[f32], action: &[f32], next_obs: &mut [f32]) {
        self.constant.complete(action, next_obs);
    }
}
