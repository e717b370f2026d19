//! Humanoid: run forward without falling.

use std::sync::Arc;

use mujoco_rs::{Data, Model};

use super::forward::effort as effort_f32;
use super::noise::add_uniform;
use super::task::{Block, block, effort, write};
use super::{Info, Locomotion, Scene, Stream, Task, Velocity};
use crate::task::{Rules, VelocityReading};

const FORWARD_WEIGHT: f64 = 1.25;
const ALIVE: f64 = 5.0;
const CONTROL_WEIGHT: f64 = 0.1;
/// Healthy heights of the torso, in metres (exclusive).
const HEIGHT: (f64, f64) = (1.0, 2.0);

/// Number of bodies, the world included.
const BODIES: usize = 14;
/// Where the observation's parts begin.
const CINERT: usize = 45;
const CVEL: usize = CINERT + 10 * BODIES;
const ACTUATOR: usize = CVEL + 6 * BODIES;
pub(super) const CONTACT: usize = ACTUATOR + 23;

/// The observation of both humanoid tasks.
pub(super) const OBSERVATION: &[Block] = &[
    block(1, "height of the torso"),
    block(4, "orientation of the torso, a quaternion (w, x, y, z)"),
    block(17, "angles of the joints"),
    block(3, "linear velocity of the torso in the world"),
    block(3, "angular velocity of the torso in its own frame"),
    block(17, "angular velocities of the joints"),
    block(
        140,
        "inertia of each of 14 bodies (world first) about the centre of mass of the whole: \
                6 moments (kg m^2), mass times offset (3), mass",
    ),
    block(84, "velocity of each body there: angular (3), linear (3)"),
    block(
        23,
        "force of the actuators on each degree of freedom (N, N m)",
    ),
    block(
        84,
        "external force on each body there: torque (3), force (3)",
    ),
];

/// A walker with arms.
pub struct Humanoid {
    masses: Vec<f64>,
    dt: f64,
}

impl Locomotion for Humanoid {
    const INFO: Info = Info {
        id: "Humanoid-v4",
        summary: "a walker with arms; run forward without falling",
        scene: Scene::File("humanoid.xml"),
        frame_skip: 5,
        max_episode_steps: 1000,
        observation: OBSERVATION,
        reward: "1.25 (x after - x before) / dt of the centre of mass + 5 - 0.1 |a|^2",
        termination: "unless 1 < height < 2",
        reset: "positions (quaternion included) and velocities uniform +-0.01",
        velocity: Velocity::Computed(
            "that of the centre of mass, from the inertias and velocities of the bodies",
        ),
        drops: false,
        relative: true,
    };

    fn new(model: &Model) -> mujoco_rs::Result<Self> {
        Ok(Self {
            masses: model.body_mass().to_vec(),
            dt: super::dt::<Self>(model),
        })
    }

    fn rules(model: &Model, reading: VelocityReading) -> mujoco_rs::Result<Arc<dyn Rules>> {
        Ok(Arc::new(Run {
            reading,
            constant: Constant::new(model),
        }))
    }
}

impl Task for Humanoid {
    /// x of the whole body's centre of mass, which lags one physics step behind the state.
    type Carried = [f64; 1];

    const CONTACT_FORCES: bool = true;

    fn start(&self, rng: &mut Stream, qpos: &mut [f64], qvel: &mut [f64]) {
        add_uniform(rng, 0.01, qpos);
        add_uniform(rng, 0.01, qvel);
    }

    fn carry(&self, data: &Data) -> [f64; 1] {
        let x = data.xipos().chunks_exact(3).map(|p| p[0]);
        let moment: f64 = self.masses.iter().zip(x).map(|(m, x)| m * x).sum();
        [moment / self.masses.iter().sum::<f64>()]
    }

    fn observe(&self, data: &Data, observation: &mut [f64]) {
        observe(data, observation);
    }

    fn reward(&self, before: &[f64; 1], after: &[f64; 1], _: &Data, action: &[f64]) -> f64 {
        let velocity = (after[0] - before[0]) / self.dt;
        FORWARD_WEIGHT * velocity + ALIVE - CONTROL_WEIGHT * effort(action)
    }

    fn terminated(&self, data: &Data) -> bool {
        !healthy(data.qpos()[2])
    }
}

fn healthy(height: f64) -> bool {
    HEIGHT.0 < height && height < HEIGHT.1
}

/// Writes the observation of both humanoid tasks.
pub(super) fn observe(data: &Data, observation: &mut [f64]) {
    let parts = [
        &data.qpos()[2..],
        data.qvel(),
        data.cinert(),
        data.cvel(),
        data.qfrc_actuator(),
        data.cfrc_ext(),
    ];
    write(observation, parts.into_iter().flatten().copied());
}

/// Rules of Humanoid.
struct Run {
    reading: VelocityReading,
    constant: Constant,
}

impl Rules for Run {
    fn reward(&self, obs: &[f32], action: &[f32], next_obs: &[f32]) -> f32 {
        let v = self.reading.of(velocity(obs), velocity(next_obs));
        FORWARD_WEIGHT as f32 * v + ALIVE as f32 - CONTROL_WEIGHT as f32 * effort_f32(action)
    }

    fn terminated(&self, next_obs: &[f32]) -> bool {
        !healthy(next_obs[0].into())
    }

    fn known(&self) -> &[usize] {
        &self.constant.known
    }

    fn complete(&self, _: &[f32], action: &[f32], next_obs: &mut [f32]) {
        self.constant.complete(action, next_obs);
    }
}

/// Forward velocity of the whole body's centre of mass, in m/s.
///
/// The observation holds each body's mass m, m times its offset r from the common centre, and the
/// velocity (w, v) of its frame there; the body's own centre moves with v + w x r.
fn velocity(obs: &[f32]) -> f32 {
    let inertias = obs[CINERT..CVEL].chunks_exact(10);
    let velocities = obs[CVEL..ACTUATOR].chunks_exact(6);
    let (mut momentum, mut total) = (0.0, 0.0);
    for (inertia, motion) in inertias.zip(velocities) {
        let (mass, y, z) = (inertia[9], inertia[7], inertia[8]);
        momentum += mass * motion[3] + motion[1] * z - motion[2] * y;
        total += mass;
    }
    momentum / total
}

/// What never changes in the observation of a humanoid, or follows from the action alone.
pub(super) struct Constant {
    /// The coordinates, ascending.
    pub(super) known: Vec<usize>,
    /// Mass of each body.
    masses: Vec<f32>,
    /// Degree of freedom, gear and command limit of each actuator.
    motors: Vec<(usize, f32, f32)>,
}

impl Constant {
    pub(super) fn new(model: &Model) -> Self {
        let motors = (0..model.nu()).map(|i| {
            let joint = model.actuator_trnid()[2 * i] as usize;
            let dof = model.jnt_dofadr()[joint] as usize;
            let gear = model.actuator_gear()[6 * i] as f32;
            (dof, gear, model.actuator_ctrlrange()[2 * i + 1] as f32)
        });
        let masses = (1..BODIES).map(|body| CINERT + 10 * body + 9);
        let known = (CINERT..CINERT + 10)
            .chain(masses)
            .chain(CVEL..CVEL + 6)
            .chain(ACTUATOR..CONTACT + 6);
        Self {
            known: known.collect(),
            masses: model.body_mass().iter().map(|&m| m as f32).collect(),
            motors: motors.collect(),
        }
    }

    /// The world does not move, masses stay, and each motor applies gear times clamped command.
    pub(super) fn complete(&self, action: &[f32], next_obs: &mut [f32]) {
        next_obs[CINERT..CINERT + 10].fill(0.0);
        for (body, mass) in self.masses.iter().enumerate() {
            next_obs[CINERT + 10 * body + 9] = *mass;
        }
        next_obs[CVEL..CVEL + 6].fill(0.0);
        next_obs[ACTUATOR..CONTACT + 6].fill(0.0);
        for (&(dof, gear, limit), a) in self.motors.iter().zip(action) {
            next_obs[ACTUATOR + dof] = gear * a.clamp(-limit, limit);
        }
    }
}
