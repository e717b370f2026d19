//! What an agent would imagine or say, without learning from it.

use super::{Agent, Augmentation, Sample};
use crate::imagination::Kept;
use crate::nn::{ObservationScaling, side_by_side};

/// Imaginary transitions and what would become of them, `[n]` rows.
#[derive(Debug, Clone, PartialEq)]
pub struct Probe {
    /// Executed imaginary actions, `[n, action_size]`.
    pub action: Vec<f32>,
    /// Imagined next observations, scaled, `[n, obs_size]`.
    pub next_obs: Vec<f32>,
    /// Imagined rewards, `[n]`.
    pub reward: Vec<f32>,
    /// Imaginary targets, `[n]`.
    pub y_hat: Vec<f32>,
    /// The rows that the filters would keep.
    pub kept: Kept,
}

impl Agent {
    /// What the agent would imagine for `sample`; none for agents that imagine no other actions.
    pub fn probe(&self, sample: &Sample, scaling: &ObservationScaling) -> Option<Probe> {
        let Augmentation::Imagination(imagination) = self.augmentation() else {
            return None;
        };
        let batch = &sample.batch;
        let all = 0..batch.rows;
        let obs = scaling.scale(&batch.obs);
        let policy = self
            .base
            .output(&self.observe(&obs, &batch.previous_action));
        let y = self.real_targets(sample, all.clone(), scaling);
        let rows = self.imagine_rows(imagination, sample, &obs, &policy, all, scaling);
        let draws = sample.model.as_ref().and_then(|m| m.imagination.as_ref())?;
        // A copy of the filters: a look must not move the running maximum.
        let mut filters = imagination.filters;
        let kept = filters.keep(&rows.y_hat, &y, &rows.values.disagreement, &draws.keep);
        Some(Probe {
            action: rows.action,
            next_obs: rows.imagined.next_obs,
            reward: rows.imagined.reward,
            y_hat: rows.y_hat,
            kept,
        })
    }

    /// The targets of the imaginary actions of a [`Probe`] had they led to `next_obs` (scaled) with these
    /// rewards and ends, under the same noise.
    pub fn imaginary_backup(
        &self,
        sample: &Sample,
        action: &[f32],
        next_obs: &[f32],
        reward: &[f32],
        terminated: &[f32],
    ) -> Vec<f32> {
        let draws = sample.model.as_ref().and_then(|m| m.imagination.as_ref());
        let noise = draws.map_or(&[][..], |draws| &draws.smoothing);
        let values = self.bootstrap(next_obs, action, noise);
        self.backup(reward, terminated, &values.value)
    }

    /// `Q1` of executed actions, row by row; observations not scaled.
    pub fn q(
        &self,
        obs: &[f32],
        previous_action: &[f32],
        action: &[f32],
        scaling: &ObservationScaling,
    ) -> Vec<f32> {
        let observed = self.observe(&scaling.scale(obs), previous_action);
        let coupling = self.settings.coupling;
        let width = coupling.observed_width(self.obs_size, self.action_size);
        let input = side_by_side(&[(&observed, width), (action, self.action_size)]);
        self.critics.first().mlp().forward(&input)
    }

    /// `Q1` of the deterministic policy's actions, row by row; observations not scaled.
    pub fn value(
        &self,
        obs: &[f32],
        previous_action: &[f32],
        scaling: &ObservationScaling,
    ) -> Vec<f32> {
        let observed = self.observe(&scaling.scale(obs), previous_action);
        let mut action = self.base.output(&observed);
        self.settings
            .coupling
            .execute_in_place(&mut action, previous_action);
        self.q(obs, previous_action, &action, scaling)
    }
}
