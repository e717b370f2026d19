//! PenSpin: keep a pen spinning in one hand, level.

use std::array::from_fn;
use std::ops::Range;

use mujoco_rs::{Data, Model, Object};

use super::layout::SPIN;
use super::noise::add_normal;
use super::pose::{POSE, Quaternion, product, rotation};
use super::{
    Command, DROPPED, HAND_JOINTS as HAND, Recorded, SETTLING_STEPS, Stream, Task, forearms,
};
use crate::task::Rules;

/// The pen's spin, about its own x axis, in `qvel` and in the observation.
const SPIN_QVEL: usize = HAND + 3;
const SPIN_OBS: usize = 2 * HAND + 3;
/// The pen's quaternion in the observation.
const QUATERNION_OBS: usize = 57;
/// The target, which follows the pen in `qpos` and `qvel` and is not observed.
const TARGET_QPOS: Range<usize> = HAND + POSE..HAND + 2 * POSE;
const TARGET_QVEL: Range<usize> = HAND + 6..HAND + 12;
/// Cost of a metre of height between the ends of the pen.
const TILT_WEIGHT: f64 = 15.0;
/// Distance of the end sites, in metres.
const LENGTH: f64 = 0.2;
/// Deviation of the pen's first position, in metres.
const START_DEVIATION: f64 = 0.005;

/// One hand and a pen, on MuJoCo.
pub struct PenSpin {
    top: usize,
    bottom: usize,
    forearms: Vec<usize>,
}

impl PenSpin {
    /// The task.
    ///
    /// # Errors
    /// If the model lacks an end of the pen or the forearm.
    pub fn new(model: &Model) -> mujoco_rs::Result<Self> {
        Ok(Self {
            top: model.id(Object::Site, "object:top")?,
            bottom: model.id(Object::Site, "object:bottom")?,
            forearms: forearms(&SPIN, model)?,
        })
    }
}

impl Task for PenSpin {
    type Carried = [f64; 0];

    const COMMAND: Command = Command::Range;

    fn start(&self, rng: &mut Stream, qpos: &mut [f64], _: &mut [f64]) {
        add_normal(rng, START_DEVIATION, &mut qpos[HAND..HAND + 3]);
    }

    fn settling_steps(&self) -> usize {
        SETTLING_STEPS
    }

    fn accepts(&self, data: &Data) -> bool {
        !self.dropped(data)
    }

    fn dropped(&self, data: &Data) -> bool {
        data.qpos()[HAND + 2] <= DROPPED
    }

    fn carry(&self, _: &Data) -> [f64; 0] {
        []
    }

    /// Velocity comes before pose, unlike in the two-hand tasks.
    fn observe(&self, data: &Data, observation: &mut [f64]) {
        let (qpos, qvel) = (data.qpos(), data.qvel());
        let (velocities, pose) = observation[HAND..].split_at_mut(HAND + 6);
        velocities.copy_from_slice(&qvel[..HAND + 6]);
        pose.copy_from_slice(&qpos[HAND..HAND + POSE]);
        observation[..HAND].copy_from_slice(&qpos[..HAND]);
    }

    fn reward(&self, _: &[f64; 0], _: &[f64; 0], data: &Data, _: &[f64]) -> f64 {
        let height = |site: usize| data.site_xpos()[3 * site + 2];
        let tilt = (height(self.top) - height(self.bottom)).abs();
        data.qvel()[SPIN_QVEL] - TILT_WEIGHT * tilt
    }

    fn recorded(&self) -> Recorded {
        Recorded {
            idle_qpos: vec![TARGET_QPOS],
            idle_qvel: vec![TARGET_QVEL],
            approximate_geoms: self.forearms.clone(),
            has_pens: true,
            spin: Some(SPIN_OBS),
        }
    }
}

/// The rules of PenSpin. The simulator measures the tilt before its last physics step moved the pen;
/// the observation holds the pen after it and the velocity of that step, so the step is undone here.
///
/// Nothing of the next observation is known beforehand: contacts change the pen's velocity within a
/// control step. Integrating the mean of the velocities at both ends, which are not known either, misses
/// the next quaternion by 0.009 (median over the published recordings, largest number), where it changes
/// by 0.067.
pub struct Spin {
    /// Seconds of a physics step.
    timestep: f64,
}

impl Spin {
    /// The rules for a simulator with this model.
    pub fn new(model: &Model) -> Self {
        Self {
            timestep: model.timestep(),
        }
    }
}

impl Rules for Spin {
    fn reward(&self, _: &[f32], _: &[f32], next_obs: &[f32]) -> f32 {
        let spin: [f64; 3] = from_fn(|i| f64::from(next_obs[SPIN_OBS + i]));
        let after: Quaternion = from_fn(|i| f64::from(next_obs[QUATERNION_OBS + i]));
        let before = product(after, turned_back(spin, self.timestep));
        (spin[0] - TILT_WEIGHT * LENGTH * steepness(before)) as f32
    }

    fn terminated(&self, _: &[f32]) -> bool {
        false
    }
}

/// The inverse of the rotation that the angular velocity `spin` makes in `time`.
fn turned_back(spin: [f64; 3], time: f64) -> Quaternion {
    let speed = spin.iter().map(|x| x * x).sum::<f64>().sqrt();
    if speed == 0.0 {
        return [1.0, 0.0, 0.0, 0.0];
    }
    rotation(-speed * time, spin.map(|x| x / speed))
}

/// How far the z axis of a body with this orientation points up or down, from 0 to 1; the quaternion
/// need not be normalised.
fn steepness([w, x, y, z]: Quaternion) -> f64 {
    let squares = w * w + x * x + y * y + z * z;
    if squares == 0.0 {
        return 0.0;
    }
    ((w * w - x * x - y * y + z * z) / squares).abs()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_level_pen_is_not_steep_and_an_upright_one_is() {
        assert_eq!(steepness([1.0, 0.0, 0.0, 0.0]), 1.0);
        assert_eq!(steepness([0.0, 3.0, 0.0, 0.0]), 1.0);
        let level = rotation(std::f64::consts::FRAC_PI_2, [1.0, 0.0, 0.0]);
        assert!(steepness(level) < 1e-12);
    }
}
