//! A batch of transitions.

use super::Transition;
use serde::{Deserialize, Serialize};
use std::ops::Range;

/// Columns of `rows` transitions, row by row, unscaled.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Batch {
    /// Number of transitions `n`.
    pub rows: usize,
    /// Observations `s`, `[n, obs_size]`.
    pub obs: Vec<f32>,
    /// Executed actions `a`, `[n, action_size]`.
    pub action: Vec<f32>,
    /// Rewards `r`, `[n]`.
    pub reward: Vec<f32>,
    /// Next observations `s'`, `[n, obs_size]`.
    pub next_obs: Vec<f32>,
    /// `d`, `[n]`: 1 where the task ended in `s'`, 0 elsewhere, also at a time limit.
    pub terminated: Vec<f32>,
    /// Previous executed actions `p`, `[n, action_size]`; 0 after a reset.
    pub previous_action: Vec<f32>,
    /// Where the rows lie in the replay buffer, `[n]`; empty where they are not from one.
    pub indices: Vec<usize>,
    /// Weights of the rows' losses, `[n]`; empty where all are 1.
    pub weights: Vec<f32>,
    /// How many rows, the last ones, are from recordings; they have no index.
    pub recorded: usize,
    /// Discounted returns that followed in the recordings, `[recorded]`: what targets of these rows are at least; empty
    /// where nothing is known.
    pub attained: Vec<f32>,
}

impl Batch {
    /// Weight of the loss of row `row`.
    pub fn weight(&self, row: usize) -> f32 {
        self.weights.get(row).copied().unwrap_or(1.0)
    }

    /// The rows that are from recordings.
    pub fn recorded_rows(&self) -> Range<usize> {
        self.rows - self.recorded..self.rows
    }

    /// Appends the transitions of `others` as ones from recordings.
    pub fn extend_recorded(&mut self, others: &Batch) {
        self.rows += others.rows;
        self.recorded += others.rows;
        self.obs.extend_from_slice(&others.obs);
        self.action.extend_from_slice(&others.action);
        self.reward.extend_from_slice(&others.reward);
        self.next_obs.extend_from_slice(&others.next_obs);
        self.terminated.extend_from_slice(&others.terminated);
        self.previous_action
            .extend_from_slice(&others.previous_action);
        self.attained.extend_from_slice(&others.attained);
    }

    /// Appends a transition.
    pub fn push(&mut self, transition: &Transition<'_>) {
        self.rows += 1;
        self.obs.extend_from_slice(transition.obs);
        self.action.extend_from_slice(transition.action);
        self.reward.push(transition.reward);
        self.next_obs.extend_from_slice(transition.next_obs);
        self.terminated.push(transition.ended());
        self.previous_action
            .extend_from_slice(transition.previous_action);
    }

    /// Overwrites row `row`.
    pub fn set(&mut self, row: usize, transition: &Transition<'_>) {
        let write = |column: &mut [f32], numbers: &[f32]| {
            column[row * numbers.len()..][..numbers.len()].copy_from_slice(numbers);
        };
        write(&mut self.obs, transition.obs);
        write(&mut self.action, transition.action);
        write(&mut self.next_obs, transition.next_obs);
        write(&mut self.previous_action, transition.previous_action);
        self.reward[row] = transition.reward;
        self.terminated[row] = transition.ended();
    }
}
