//! What one task adds to the shared [`Simulation`](super::simulation::Simulation).

use std::sync::Arc;

use mujoco_rs::{Data, Model};

use super::{Rules, VelocityReading};
use crate::random::Stream;

/// A named part of an observation.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Block {
    /// How many numbers it has.
    pub len: usize,
    /// What they are, with units where these are not radians, metres and seconds.
    pub what: &'static str,
}

/// A [`Block`] of `len` numbers.
pub(super) const fn block(len: usize, what: &'static str) -> Block {
    Block { len, what }
}

/// How the rules find the forward velocity in an observation.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Velocity {
    /// The reward is about no velocity.
    None,
    /// It is the number with this index.
    Index(usize),
    /// It is computed from several numbers, as told.
    Computed(&'static str),
}

/// What is known of a task without simulating it: figures for the simulation, words for the reader.
#[derive(Debug, Clone, Copy)]
pub struct Info {
    /// Registered id, for example `HalfCheetah-v4`.
    pub id: &'static str,
    /// One line on the task.
    pub summary: &'static str,
    /// Name of the scene among the embedded models, for example `half_cheetah.xml`.
    pub scene: &'static str,
    /// Physics steps a control step.
    pub frame_skip: usize,
    /// Control steps until an episode is truncated.
    pub max_episode_steps: usize,
    /// The observation's parts, in order.
    pub observation: &'static [Block],
    /// The reward in words and formulas.
    pub reward: &'static str,
    /// When an episode terminates.
    pub termination: &'static str,
    /// How an episode begins.
    pub reset: &'static str,
    /// Where the forward reward's velocity is read from an observation.
    pub velocity: Velocity,
    /// Whether the published task's figures are compared relative to their size (forces of thousands
    /// of newtons under an iterative solver) instead of absolutely.
    pub relative: bool,
}

impl Info {
    /// Length of an observation.
    pub fn obs_size(&self) -> usize {
        self.observation.iter().map(|block| block.len).sum()
    }

    /// Whether the reward depends on how the velocity is read.
    pub fn reads_velocity(&self) -> bool {
        self.velocity != Velocity::None
    }

    /// The observation's parts with the index at which each begins.
    pub fn blocks(&self) -> impl Iterator<Item = (usize, Block)> {
        self.observation.iter().scan(0, |next, &block| {
            let start = *next;
            *next += block.len;
            Some((start, block))
        })
    }
}

/// What one task adds to the shared simulation: a task file implements this and nothing else.
///
/// Where a method reads body positions, centre-of-mass quantities or forces after a step, it gets
/// them as they were before the last physics sub-step was integrated; the published tasks read them
/// so, and no forward pass is to be added.
pub trait Task: Send + Sized + 'static {
    /// Figures of the state before a step that the reward of the step needs (often none or one).
    type Carried: AsRef<[f64]> + AsMut<[f64]> + Copy + Send;

    /// The task's constants.
    const INFO: Info;

    /// Whether the observation or reward reads contact forces on bodies, which cost an extra pass.
    const CONTACT_FORCES: bool = false;

    /// Looks up whatever ids the task needs.
    ///
    /// # Errors
    /// If the model lacks an object the task reads.
    fn new(model: &Model) -> mujoco_rs::Result<Self>;

    /// The task's rules on observations.
    ///
    /// # Errors
    /// If the model lacks an object the rules read.
    fn rules(model: &Model, reading: VelocityReading) -> mujoco_rs::Result<Arc<dyn Rules>>;

    /// Draws the state in which an episode begins; `qpos` arrives as `qpos0`, `qvel` as zeros.
    fn start(&self, rng: &mut Stream, qpos: &mut [f64], qvel: &mut [f64]);

    /// Reads the figures that the next step's reward will need.
    fn carry(&self, data: &Data) -> Self::Carried;

    /// Writes the observation.
    fn observe(&self, data: &Data, observation: &mut [f64]);

    /// Reward of the step that led here under `action`, from the figures `before` and after it.
    fn reward(
        &self,
        before: &Self::Carried,
        after: &Self::Carried,
        data: &Data,
        action: &[f64],
    ) -> f64;

    /// Whether the task ends in this state.
    fn terminated(&self, _data: &Data) -> bool {
        false
    }
}

/// Seconds of a control step.
pub(super) fn dt<T: Task>(model: &Model) -> f64 {
    model.timestep() * T::INFO.frame_skip as f64
}

/// Writes `numbers` one after the other.
pub(super) fn write(out: &mut [f64], numbers: impl IntoIterator<Item = f64>) {
    let mut slots = out.iter_mut();
    for number in numbers {
        if let Some(slot) = slots.next() {
            *slot = number;
        }
    }
    debug_assert!(slots.next().is_none());
}

/// Sum of squares of an action's numbers.
pub(super) fn effort(action: &[f64]) -> f64 {
    action.iter().map(|a| a * a).sum()
}

/// Position of body `id` in the world.
pub(super) fn body_position(data: &Data, id: usize) -> [f64; 3] {
    let p = &data.xpos()[3 * id..][..3];
    [p[0], p[1], p[2]]
}

/// Euclidean distance.
pub(super) fn distance(a: [f64; 3], b: [f64; 3]) -> f64 {
    let squares = a.iter().zip(&b).map(|(a, b)| (a - b) * (a - b));
    squares.sum::<f64>().sqrt()
}
