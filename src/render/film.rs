//! What is kept of an episode to draw it afterwards.

use crate::env::Inspect;
use crate::task::Step;

/// One state as it is drawn.
#[derive(Debug, Clone, PartialEq)]
pub struct Shot {
    /// Positions of the scene, `nq`.
    pub qpos: Vec<f64>,
    /// Control steps since the episode began.
    pub step: usize,
    /// Reward of the step that led here; `None` at the beginning, or where nothing is known of it.
    pub reward: Option<f64>,
    /// Sum of the rewards so far; `None` where nothing is known of them.
    pub episode_return: Option<f64>,
    /// Whether the goal is reached here; `None` for a task that knows no success.
    pub success: Option<bool>,
}

/// The states of one episode, in order.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Film {
    shots: Vec<Shot>,
}

impl Film {
    /// Begins with the state that `env` is in.
    pub fn begin(env: &dyn Inspect) -> Film {
        Film {
            shots: vec![Shot {
                qpos: env.shown_qpos(),
                step: 0,
                reward: None,
                episode_return: Some(0.0),
                success: None,
            }],
        }
    }

    /// Appends the state that a step led to; nothing where the simulation diverged.
    pub fn step(&mut self, env: &dyn Inspect, step: &Step) {
        if step.diverged {
            return;
        }
        let before = self.shots.last().and_then(|shot| shot.episode_return);
        self.shots.push(Shot {
            qpos: env.shown_qpos(),
            step: self.shots.len(),
            reward: Some(step.reward),
            episode_return: Some(before.unwrap_or(0.0) + step.reward),
            success: step.success,
        });
    }

    /// Appends a state.
    pub fn push(&mut self, shot: Shot) {
        self.shots.push(shot);
    }

    /// Keeps the beginning and at most `steps` steps.
    pub fn cut_to(&mut self, steps: usize) {
        self.shots.truncate(steps.saturating_add(1));
    }

    /// Keeps the last state only.
    pub fn cut_to_last(&mut self) {
        self.shots.drain(..self.shots.len().saturating_sub(1));
    }

    /// The states.
    pub fn shots(&self) -> &[Shot] {
        &self.shots
    }
}
