//! Targets by the target networks.

use super::Agent;
use super::critics::Values;
use crate::agent::Sample;
use crate::nn::{ObservationScaling, rows_of, side_by_side};
use std::ops::Range;

impl Agent {
    /// `y = r + gamma (1 - d) min(Q1', Q2')(s', a')` (equation 4) of the rows `range`.
    pub(super) fn real_targets(
        &self,
        sample: &Sample,
        range: Range<usize>,
        scaling: &ObservationScaling,
    ) -> Vec<f32> {
        let (batch, sa) = (&sample.batch, self.action_size);
        let next = scaling.scale(rows_of(&batch.next_obs, self.obs_size, &range));
        let action = rows_of(&batch.action, sa, &range);
        let values = self.bootstrap(&next, action, rows_of(&sample.smoothing, sa, &range));
        let (reward, terminated) = (&batch.reward[range.clone()], &batch.terminated[range]);
        self.backup(reward, terminated, &values.value)
    }

    /// Target critics at the policy's next action in `next_obs` (scaled), reached by `action`; `noise`
    /// is standard normal. The entropy's share of the value is in it.
    pub(super) fn bootstrap(&self, next_obs: &[f32], action: &[f32], noise: &[f32]) -> Values {
        let coupling = self.settings.coupling;
        let observed = self.observe(next_obs, action);
        let width = coupling.observed_width(self.obs_size, self.action_size);
        let next = self.base.next_output(&observed, noise);
        let mut next_action = next.output;
        coupling.execute_in_place(&mut next_action, action);
        let input = side_by_side(&[(&observed, width), (&next_action, self.action_size)]);
        let mut values = self.critics.target_values(&input);
        for (value, penalty) in values.value.iter_mut().zip(next.penalty.iter().flatten()) {
            *value -= penalty;
        }
        values
    }

    /// `r + gamma (1 - d) value`.
    pub(super) fn backup(&self, reward: &[f32], terminated: &[f32], value: &[f32]) -> Vec<f32> {
        let discount = self.settings.discount as f32;
        let rows = reward.iter().zip(terminated).zip(value);
        rows.map(|((r, d), v)| r + discount * (1.0 - d) * v)
            .collect()
    }
}
