//! The two-hand tasks: bring one object, or two, to a goal pose.

use std::array::from_fn;
use std::ops::Range;

use mujoco_rs::{Data, Model};

use super::layout::{Beginning, Layout, POISED, Region};
use super::noise::uniform;
use super::pose::{POSE, distance, product, random_rotation};
use super::scene::Object;
use super::{Command, DROPPED, HAND_JOINTS, Recorded, SETTLING_STEPS, Stream, Task, forearms};
use crate::task::Rules;

/// Joints of a moving mount.
const MOUNT_JOINTS: usize = 6;
/// Velocity of a free body: linear in the world, angular in its own frame.
const TWIST: usize = 6;

/// Success is a distance below these, in metres and radians.
const POSITION_THRESHOLD: f64 = 0.01;
const ROTATION_THRESHOLD: f64 = 0.1;

/// Which reward a task gives.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Reward {
    /// An exponential of the distance to the goal.
    Dense,
    /// 0 at the goal, -1 elsewhere.
    Sparse,
}

/// Where a family's numbers are in `qpos`, `qvel` and observations.
#[derive(Debug, Clone, Copy)]
pub struct Indices {
    /// Joints of one hand, mount included.
    hand: usize,
    /// Objects, one or two.
    objects: usize,
}

impl Indices {
    pub fn new(layout: &Layout) -> Self {
        let mount = if layout.moving { MOUNT_JOINTS } else { 0 };
        Self {
            hand: HAND_JOINTS + mount,
            objects: layout.places.len(),
        }
    }

    /// Joints of hand `i`, in `qpos` and `qvel` alike.
    fn joints(&self, i: usize) -> Range<usize> {
        i * self.hand..(i + 1) * self.hand
    }

    /// Pose of body `body` (object, target, second object, second target) in `qpos`.
    fn qpos(&self, body: usize) -> Range<usize> {
        let start = 2 * self.hand + body * POSE;
        start..start + POSE
    }

    /// Velocity of the same bodies in `qvel`.
    fn qvel(&self, body: usize) -> Range<usize> {
        let start = 2 * self.hand + body * TWIST;
        start..start + TWIST
    }

    /// Pose of object `i` in the observation.
    fn observed(&self, i: usize) -> usize {
        4 * self.hand + i * (POSE + TWIST)
    }

    /// The goal of object `i` in the observation.
    fn goal(&self, i: usize) -> usize {
        self.observed(self.objects) + i * POSE
    }

    /// Length of an observation, goal included.
    fn obs_size(&self) -> usize {
        self.goal(self.objects)
    }
}

/// A two-hand task on MuJoCo.
pub struct TwoHands {
    layout: &'static Layout,
    object: Object,
    reward: Reward,
    indices: Indices,
    goal: Vec<f64>,
    forearms: Vec<usize>,
}

impl TwoHands {
    /// The task of this family, object and reward.
    ///
    /// # Errors
    /// If the model lacks a forearm.
    pub fn new(
        layout: &'static Layout,
        object: Object,
        reward: Reward,
        model: &Model,
    ) -> mujoco_rs::Result<Self> {
        let indices = Indices::new(layout);
        Ok(Self {
            layout,
            object,
            reward,
            indices,
            goal: vec![0.0; indices.objects * POSE],
            forearms: forearms(layout, model)?,
        })
    }

    /// The region of the first object's goal, for objects that settled at `qpos`: the one whose centre is
    /// farther from it (in a tie the second).
    fn first_region(&self, qpos: &[f64]) -> usize {
        let object = &qpos[self.indices.qpos(0)];
        let distances = self.layout.goals.each_ref().map(|region| {
            let centre = region.centre();
            (0..3).map(|i| (object[i] - centre[i]).powi(2)).sum::<f64>()
        });
        usize::from(distances[0] <= distances[1])
    }

    /// Where goals lie, object by object, if the first one's lies in region `first`: the second one's
    /// lies in the other.
    fn regions(&self, first: usize) -> impl Iterator<Item = &'static Region> {
        let goals = &self.layout.goals;
        (first..).map(move |i| &goals[i % 2])
    }

    /// How far `goal` is from what can be drawn if the first object's goal lies in region `first`:
    /// distance from the region, of the quaternion from unit length, or of its first number below 0.
    fn distance_from_goals(&self, goal: &[f64], first: usize) -> f64 {
        let goals = goal.chunks_exact(POSE).zip(self.regions(first));
        let errors = goals.map(|(goal, region)| {
            let outside = (0..3).map(|j| goal[j] - goal[j].clamp(region.low[j], region.high[j]));
            let norm = goal[3..].iter().map(|x| x * x).sum::<f64>().sqrt();
            let errors = outside.chain([norm - 1.0, goal[3].min(0.0)]);
            errors.fold(0.0, |largest: f64, error| largest.max(error.abs()))
        });
        errors.fold(0.0, f64::max)
    }

    /// Object and goal poses.
    fn poses<'a>(
        &'a self,
        data: &'a Data,
    ) -> impl Iterator<Item = ([f64; POSE], [f64; POSE])> + 'a {
        (0..self.indices.objects).map(|i| {
            let object = &data.qpos()[self.indices.qpos(2 * i)];
            let goal = &self.goal[i * POSE..];
            (from_fn(|j| object[j]), from_fn(|j| goal[j]))
        })
    }
}

/// Dense reward of one object at these distances from its goal.
fn closeness([scale, position_weight]: [f64; 2], (position, angle): (f64, f64)) -> f64 {
    (-scale * (position_weight * position + angle)).exp()
}

fn reached((position, angle): (f64, f64)) -> bool {
    position < POSITION_THRESHOLD && angle < ROTATION_THRESHOLD
}

/// Reward of objects at these poses with these goals.
fn reward_of(
    kind: Reward,
    layout: &Layout,
    mut poses: impl Iterator<Item = ([f64; POSE], [f64; POSE])>,
) -> f64 {
    match kind {
        Reward::Dense => poses
            .map(|(object, goal)| closeness(layout.reward, distance(&object, &goal)))
            .sum(),
        Reward::Sparse => {
            let all = poses.all(|(object, goal)| reached(distance(&object, &goal)));
            f64::from(u8::from(all)) - 1.0
        }
    }
}

impl Task for TwoHands {
    type Carried = [f64; 0];

    const COMMAND: Command = Command::Range;

    fn start(&self, rng: &mut Stream, qpos: &mut [f64], _: &mut [f64]) {
        match self.layout.beginning {
            Beginning::Poised(position) => {
                qpos[..POISED.len()].copy_from_slice(&POISED);
                let object = &mut qpos[self.indices.qpos(0)];
                object[..3].copy_from_slice(&position);
                object[3..].copy_from_slice(&match self.object {
                    Object::Pen => [0.5; 4],
                    Object::Egg | Object::Block => [1.0, 0.0, 0.0, 0.0],
                });
            }
            Beginning::Settled => {
                if self.object == Object::Pen {
                    return;
                }
                for i in 0..self.indices.objects {
                    let quaternion = &mut qpos[self.indices.qpos(2 * i)][3..];
                    let turned = product(from_fn(|j| quaternion[j]), random_rotation(rng));
                    quaternion.copy_from_slice(&turned);
                }
            }
        }
    }

    fn settling_steps(&self) -> usize {
        match self.layout.beginning {
            Beginning::Settled => SETTLING_STEPS,
            Beginning::Poised(_) => 0,
        }
    }

    fn draw_goal(&self, rng: &mut Stream, qpos: &[f64], goal: &mut [f64]) {
        for (goal, region) in goal
            .chunks_exact_mut(POSE)
            .zip(self.regions(self.first_region(qpos)))
        {
            let bounds = region.low.iter().zip(&region.high);
            for (x, (low, high)) in goal.iter_mut().zip(bounds) {
                *x = uniform(rng, *low, *high);
            }
        }
        for goal in goal.chunks_exact_mut(POSE) {
            goal[3..].copy_from_slice(&random_rotation(rng));
        }
    }

    fn place_targets(&self, qpos: &mut [f64]) {
        for (i, goal) in self.goal.chunks_exact(POSE).enumerate() {
            qpos[self.indices.qpos(2 * i + 1)].copy_from_slice(goal);
        }
    }

    fn goal_error(&self, qpos: &[f64], goal: &[f64], settled: bool) -> f64 {
        let first = self.first_region(qpos);
        let drawn = self.distance_from_goals(goal, first);
        if settled {
            drawn
        } else {
            drawn.min(self.distance_from_goals(goal, 1 - first))
        }
    }

    fn achieved_goal(&self, data: &Data, achieved: &mut [f64]) {
        for (i, pose) in achieved.chunks_exact_mut(POSE).enumerate() {
            pose.copy_from_slice(&data.qpos()[self.indices.qpos(2 * i)]);
        }
    }

    fn goal(&self) -> &[f64] {
        &self.goal
    }

    fn set_goal(&mut self, goal: &[f64]) {
        self.goal.copy_from_slice(goal);
    }

    fn carry(&self, _: &Data) -> [f64; 0] {
        []
    }

    fn observe(&self, data: &Data, observation: &mut [f64]) {
        let (qpos, qvel) = (data.qpos(), data.qvel());
        let mut rest = observation;
        let mut write = |numbers: &[f64]| {
            let (part, tail) = std::mem::take(&mut rest).split_at_mut(numbers.len());
            part.copy_from_slice(numbers);
            rest = tail;
        };
        for i in 0..2 {
            write(&qpos[self.indices.joints(i)]);
            write(&qvel[self.indices.joints(i)]);
        }
        for i in 0..self.indices.objects {
            write(&qpos[self.indices.qpos(2 * i)]);
            write(&qvel[self.indices.qvel(2 * i)]);
        }
    }

    fn reward(&self, _: &[f64; 0], _: &[f64; 0], data: &Data, _: &[f64]) -> f64 {
        reward_of(self.reward, self.layout, self.poses(data))
    }

    fn dropped(&self, data: &Data) -> bool {
        let mut poses = self.poses(data);
        poses.any(|(object, _)| object[2] <= DROPPED)
    }

    fn success(&self, data: &Data) -> Option<bool> {
        let mut poses = self.poses(data);
        Some(poses.all(|(object, goal)| reached(distance(&object, &goal))))
    }

    fn recorded(&self) -> Recorded {
        let targets = || (0..self.indices.objects).map(|i| 2 * i + 1);
        Recorded {
            idle_qpos: targets().map(|body| self.indices.qpos(body)).collect(),
            idle_qvel: targets().map(|body| self.indices.qvel(body)).collect(),
            approximate_geoms: self.forearms.clone(),
            has_pens: self.object == Object::Pen,
            spin: None,
        }
    }
}

/// The rules of a two-hand task: the reward is read from object and goal, the goal stays.
pub struct Handle {
    layout: &'static Layout,
    reward: Reward,
    indices: Indices,
    known: Vec<usize>,
}

impl Handle {
    /// The rules of this family and reward.
    pub fn new(layout: &'static Layout, reward: Reward) -> Self {
        let indices = Indices::new(layout);
        Self {
            layout,
            reward,
            indices,
            known: (indices.goal(0)..indices.obs_size()).collect(),
        }
    }
}

impl Rules for Handle {
    fn reward(&self, _: &[f32], _: &[f32], next_obs: &[f32]) -> f32 {
        let pose = |start: usize| from_fn(|j| f64::from(next_obs[start + j]));
        let poses = (0..self.indices.objects)
            .map(|i| (pose(self.indices.observed(i)), pose(self.indices.goal(i))));
        reward_of(self.reward, self.layout, poses) as f32
    }

    fn terminated(&self, _: &[f32]) -> bool {
        false
    }

    fn known(&self) -> &[usize] {
        &self.known
    }

    fn complete(&self, obs: &[f32], _: &[f32], next_obs: &mut [f32]) {
        let goal = self.indices.goal(0)..self.indices.obs_size();
        next_obs[goal.clone()].copy_from_slice(&obs[goal]);
    }
}
