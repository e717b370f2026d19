//! Imaginary transitions of the same states by other actions (paper, equations 7 to 10).

use super::critics::CriticRows;
use super::{Agent, ImaginationFigures, Sample};
use crate::imagination::{Imagination, Kept};
use crate::nn::{ObservationScaling, rows_of};
use crate::parallel::halves;
use crate::replay::Batch;
use std::ops::Range;

/// Imaginary transitions and their targets, all rows, whether kept or not.
#[derive(Debug, Clone, PartialEq)]
pub struct ImaginaryTargets {
    /// Executed imaginary actions `a_hat` (equation 7), `[n, action_size]`.
    pub action: Vec<f32>,
    /// Imaginary targets `y_hat`, `[n]`.
    pub y_hat: Vec<f32>,
    /// Disagreement `Delta` of the target critics at `s_hat` (equation 9), `[n]`.
    pub disagreement: Vec<f32>,
    /// The rows that train the critics.
    pub kept: Kept,
    /// Weight of a kept row's squared error (equation 10).
    pub row_weight: f32,
    /// Bound `eta` that the actions' noise was clipped to.
    pub noise_bound: f64,
}

impl Agent {
    /// Imaginary actions, where they lead, their targets and which of them are kept. `policy` is the
    /// deterministic output of the policy for the batch.
    pub(super) fn imaginary_targets(
        &self,
        imagination: &mut Imagination,
        sample: &Sample,
        obs: &[f32],
        policy: &[f32],
        y: &[f32],
        scaling: &ObservationScaling,
    ) -> ImaginaryTargets {
        let batch = &sample.batch;
        let draws = sample.model.as_ref().and_then(|m| m.imagination.as_ref());
        let draws = draws.expect("an agent that imagines is given draws");
        let noise_bound = imagination.noise_bound();
        let (so, sa) = (self.obs_size, self.action_size);
        let coupling = self.settings.coupling;

        let half = |range: Range<usize>| {
            let rows = |data, width| rows_of(data, width, &range);
            let mut action = rows(policy, sa).to_vec();
            imagination.add_noise(&mut action, rows(&draws.action, sa));
            coupling.execute_in_place(&mut action, rows(&batch.previous_action, sa));
            let world = &imagination.world;
            let imagined = world.imagine(rows(&batch.obs, so), rows(obs, so), &action, scaling);
            let values = self.bootstrap(&imagined.next_obs, &action, rows(&draws.smoothing, sa));
            let y_hat = self.backup(&imagined.reward, &imagined.terminated, &values.value);
            (action, y_hat, values.disagreement)
        };
        let [first, second] = halves(batch.rows, half);
        let action = [first.0, second.0].concat();
        let y_hat = [first.1, second.1].concat();
        let disagreement = [first.2, second.2].concat();
        imagination.decay_noise();
        let kept = imagination.filter(&y_hat, y, &disagreement, &draws.keep);
        ImaginaryTargets {
            row_weight: imagination.row_weight(kept.rows.len(), batch.rows),
            action,
            y_hat,
            disagreement,
            kept,
            noise_bound,
        }
    }
}

impl ImaginaryTargets {
    /// Appends the kept rows to those of the real transitions, which were observed as `observed`.
    pub(super) fn extend(&self, rows: &mut CriticRows, observed: &[f32], batch: &Batch) {
        let (width, sa) = (observed.len() / batch.rows, self.action.len() / batch.rows);
        for &i in &self.kept.rows {
            let observed = &observed[i * width..][..width];
            let action = &self.action[i * sa..][..sa];
            rows.extend(observed, width, action, &self.y_hat[i..=i], self.row_weight);
        }
    }

    /// What it was like, of `rows` rows.
    pub(super) fn figures(&self, rows: usize) -> ImaginationFigures {
        let fraction = |n: usize| n as f64 / rows as f64;
        ImaginationFigures {
            noise_bound: self.noise_bound,
            by_target: fraction(self.kept.by_target),
            by_uncertainty: fraction(self.kept.by_uncertainty),
            kept: fraction(self.kept.rows.len()),
        }
    }
}
