//! A batch of transitions.

/// Columns of `rows` transitions, row by row, unscaled.
#[derive(Debug, Clone, Default, PartialEq)]
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
}
