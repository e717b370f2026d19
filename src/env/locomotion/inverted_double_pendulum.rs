//! InvertedDoublePendulum: keep two poles up.

use std::sync::Arc;

use mujoco_rs::{Data, Model, Object};

use super::noise::{add_normal, add_uniform};
use super::task::{block, write};
use super::{Info, Locomotion, Scene, Stream, Task, Velocity};
use crate::task::{Rules, VelocityReading};

/// Velocities and forces are observed within this bound.
const MAX_OBSERVED: f64 = 10.0;
/// Length of each pole, in metres.
const POLE: f32 = 0.6;

/// Two poles in a chain on a cart.
pub struct InvertedDoublePendulum {
    tip: usize,
}

impl Locomotion for InvertedDoublePendulum {
    const INFO: Info = Info {
        id: "InvertedDoublePendulum-v4",
        summary: "two poles in a chain on a cart; keep them up",
        scene: Scene::File("inverted_double_pendulum.xml"),
        frame_skip: 5,
        max_episode_steps: 1000,
        observation: &[
            block(1, "position of the cart"),
            block(
                2,
                "sines of the two angles, the second relative to the first",
            ),
            block(2, "cosines of the two angles"),
            block(3, "velocities of cart and angles within +-10"),
            block(
                3,
                "constraint forces on cart and angles within +-10 (N, N m)",
            ),
        ],
        reward: "10 - 0.01 x^2 - (z - 2)^2 - 0.001 w1^2 - 0.005 w2^2, x and z of the upper tip, w \
                 the angular velocities",
        termination: "when the tip's z <= 1",
        reset: "positions uniform +-0.1, velocities normal with deviation 0.1",
        velocity: Velocity::None,
        drops: false,
        relative: false,
    };

    fn new(model: &Model) -> mujoco_rs::Result<Self> {
        Ok(Self {
            tip: model.id(Object::Site, "tip")?,
        })
    }

    fn rules(_: &Model, _: VelocityReading) -> mujoco_rs::Result<Arc<dyn Rules>> {
        Ok(Arc::new(BothUpright))
    }
}

impl Task for InvertedDoublePendulum {
    type Carried = [f64; 0];

    fn start(&self, rng: &mut Stream, qpos: &mut [f64], qvel: &mut [f64]) {
        add_uniform(rng, 0.1, qpos);
        add_normal(rng, 0.1, qvel);
    }

    fn carry(&self, _: &Data) -> [f64; 0] {
        []
    }

    fn observe(&self, data: &Data, observation: &mut [f64]) {
        let qpos = data.qpos();
        let sines = qpos[1..].iter().map(|q| q.sin());
        let cosines = qpos[1..].iter().map(|q| q.cos());
        let rest = data.qvel().iter().chain(data.qfrc_constraint());
        let rest = rest.map(|x| x.clamp(-MAX_OBSERVED, MAX_OBSERVED));
        let numbers = [qpos[0]].into_iter().chain(sines).chain(cosines);
        write(observation, numbers.chain(rest));
    }

    fn reward(&self, _: &[f64; 0], _: &[f64; 0], data: &Data, _: &[f64]) -> f64 {
        let (x, z) = self.tip(data);
        let (w1, w2) = (data.qvel()[1], data.qvel()[2]);
        let distance = 0.01 * x * x + (z - 2.0) * (z - 2.0);
        10.0 - distance - (1e-3 * w1 * w1 + 5e-3 * w2 * w2)
    }

    fn terminated(&self, data: &Data) -> bool {
        self.tip(data).1 <= 1.0
    }
}

impl InvertedDoublePendulum {
    fn tip(&self, data: &Data) -> (f64, f64) {
        let p = &data.site_xpos()[3 * self.tip..];
        (p[0], p[2])
    }
}

/// The tip's position follows from the observation after the step.
struct BothUpright;

/// x and z of the upper tip.
fn tip(obs: &[f32]) -> (f32, f32) {
    let (s1, s2, c1, c2) = (obs[1], obs[2], obs[3], obs[4]);
    let x = obs[0] + POLE * (s1 + s1 * c2 + c1 * s2);
    let z = POLE * (c1 + c1 * c2 - s1 * s2);
    (x, z)
}

impl Rules for BothUpright {
    fn reward(&self, _: &[f32], _: &[f32], next_obs: &[f32]) -> f32 {
        let (x, z) = tip(next_obs);
        let (w1, w2) = (next_obs[6], next_obs[7]);
        let distance = 0.01 * x * x + (z - 2.0) * (z - 2.0);
        10.0 - distance - (1e-3 * w1 * w1 + 5e-3 * w2 * w2)
    }

    fn terminated(&self, next_obs: &[f32]) -> bool {
        tip(next_obs).1 <= 1.0
    }

    /// Nothing limits the angles, so no constraint ever acts on them.
    fn known(&self) -> &[usize] {
        &[9, 10]
    }

    fn complete(&self, _: &[f32], _: &[f32], next_obs: &mut [f32]) {
        next_obs[9..11].fill(0.0);
    }
}
