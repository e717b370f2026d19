//! What one task adds to the shared [`Simulation`](super::simulation::Simulation).

use std::ops::Range;

use mujoco_rs::Data;

use super::scene::Scene;
use crate::core::random::Stream;

/// A named part of an observation.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Block {
    /// How many numbers it has.
    pub len: usize,
    /// What they are, with units where these are not radians, metres and seconds.
    pub what: &'static str,
    /// Whether they are the goal, which stays as it is for a whole episode.
    pub goal: bool,
}

/// A [`Block`] of `len` numbers.
pub const fn block(len: usize, what: &'static str) -> Block {
    Block {
        len,
        what,
        goal: false,
    }
}

/// A [`Block`] of `len` numbers of the goal; such blocks come last.
pub(super) const fn goal(len: usize, what: &'static str) -> Block {
    Block {
        len,
        what,
        goal: true,
    }
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
    /// Where its model comes from.
    pub scene: Scene,
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
    /// Whether an object can fall out of reach, where rewards are next to nothing for good.
    pub drops: bool,
    /// Whether the published task's figures are compared relative to their size (forces of thousands
    /// of newtons under an iterative solver) instead of absolutely.
    pub relative: bool,
}

impl Info {
    /// Length of an observation, goal included.
    pub fn obs_size(&self) -> usize {
        self.observation.iter().map(|block| block.len).sum()
    }

    /// Length of the goal at the end of an observation; 0 for a task without one.
    pub fn goal_size(&self) -> usize {
        let goals = self.observation.iter().filter(|block| block.goal);
        goals.map(|block| block.len).sum()
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

/// How an action becomes the command of the actuators.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Command {
    /// It is the command; MuJoCo clamps it where it computes forces.
    Action,
    /// Clipped to [-1, 1], it spans each actuator's range: 0 is the middle.
    Range,
}

/// What one task adds to the shared simulation.
///
/// Where a method reads body positions, centre-of-mass quantities or forces after a step, it gets
/// them as they were before the last physics sub-step was integrated; the published tasks read them
/// so, and no forward pass is to be added.
pub trait Task: Send {
    /// Figures of the state before a step that the reward of the step needs (often none or one).
    type Carried: AsRef<[f64]> + AsMut<[f64]> + Copy + Send;

    /// Whether the observation or reward reads contact forces on bodies, which cost an extra pass.
    const CONTACT_FORCES: bool = false;

    /// How actions become commands.
    const COMMAND: Command = Command::Action;

    /// Draws the state in which an episode begins; `qpos` arrives as `qpos0`, `qvel` as zeros.
    fn start(&self, rng: &mut Stream, qpos: &mut [f64], qvel: &mut [f64]);

    /// Control steps under the zero action between [`start`](Task::start) and the first observation.
    fn settling_steps(&self) -> usize {
        0
    }

    /// Whether an episode may begin in the state that settled; if not, the start is drawn again.
    fn accepts(&self, _data: &Data) -> bool {
        true
    }

    /// Draws a goal as an episode gets it whose objects settled at `qpos`.
    fn draw_goal(&self, _rng: &mut Stream, _qpos: &[f64], _goal: &mut [f64]) {}

    /// The goal of the episode; empty for a task without one.
    fn goal(&self) -> &[f64] {
        &[]
    }

    /// Sets the goal of the episode, as long as [`goal`](Task::goal).
    fn set_goal(&mut self, _goal: &[f64]) {}

    /// Writes what the goal would have to be to be reached in this state.
    fn achieved_goal(&self, _data: &Data, _achieved: &mut [f64]) {}

    /// Moves the targets in `qpos` to the goal of the episode.
    fn place_targets(&self, _qpos: &mut [f64]) {}

    /// How far `goal` lies from the goals that [`draw_goal`](Task::draw_goal) can give: for objects that
    /// settled at `qpos`, or, unless these have `settled`, for objects anywhere.
    fn goal_error(&self, _qpos: &[f64], _goal: &[f64], _settled: bool) -> f64 {
        0.0
    }

    /// Reads the figures that the next step's reward will need.
    fn carry(&self, data: &Data) -> Self::Carried;

    /// Writes the observation but for the goal, which the simulation appends.
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

    /// Whether an object lies out of reach in this state ([`Info::drops`]).
    fn dropped(&self, _data: &Data) -> bool {
        false
    }

    /// Whether the goal is reached in this state; `None` for a task that knows no success.
    fn success(&self, _data: &Data) -> Option<bool> {
        None
    }

    /// What recordings leave open of this task's state.
    fn recorded(&self) -> Recorded {
        Recorded::default()
    }
}

/// What a comparison with recordings must know of a task.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Recorded {
    /// Ranges of `qpos` on which nothing depends: bodies that touch nothing and are not observed.
    pub idle_qpos: Vec<Range<usize>>,
    /// The same of `qvel`.
    pub idle_qvel: Vec<Range<usize>>,
    /// Geoms whose shape is not that of the published model: steps in which something touches them
    /// differ.
    pub approximate_geoms: Vec<usize>,
    /// Whether pens are handled, whose inertia recordings name.
    pub has_pens: bool,
    /// Index in the observation of the spin that the reward counts.
    pub spin: Option<usize>,
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
