//! Imaginary transitions of the same states by other actions (paper, equations 7 to 10).

use super::agent::Seen;
use super::critics::{CriticRows, Values};
use super::{Agent, ImaginationDraws, ImaginationFigures, Sample, Targets};
use crate::imagination::{Imagination, Imagined, Kept};
use crate::nn::{Gradient, ObservationScaling, rows_of};
use crate::parallel::{halves, join};
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
    /// The step of the model; then imaginary actions, where they lead, their targets and which of them are kept.
    pub(super) fn imaginary_targets(
        &self,
        imagination: &mut Imagination,
        gradient: Gradient,
        seen: &Seen<'_>,
        targets: &Targets,
    ) -> ImaginaryTargets {
        let Seen {
            sample,
            obs,
            scaling,
        } = *seen;
        let batch = &sample.batch;
        // What the policy does in the batch's states does not need the model.
        let ((), policy) = join(
            || imagination.world.model.step(gradient),
            || self.base.output(&targets.observed),
        );
        let noise_bound = imagination.noise_bound();
        let read = &*imagination;
        let half = |range| self.imagine_rows(read, sample, obs, &policy, range, scaling);
        let [first, second] = halves(batch.rows, half);
        let action = [first.action, second.action].concat();
        let y_hat = [first.y_hat, second.y_hat].concat();
        let disagreement = [first.values.disagreement, second.values.disagreement].concat();
        imagination.decay_noise();
        let uniform = &draws(sample).keep;
        let kept = imagination
            .filters
            .keep(&y_hat, &targets.y, &disagreement, uniform);
        ImaginaryTargets {
            row_weight: imagination.row_weight(kept.rows.len(), batch.rows),
            action,
            y_hat,
            disagreement,
            kept,
            noise_bound,
        }
    }

    /// Imaginary actions of the rows `range` and where they lead.
    pub(super) fn imagine_rows(
        &self,
        imagination: &Imagination,
        sample: &Sample,
        obs: &[f32],
        policy: &[f32],
        range: Range<usize>,
        scaling: &ObservationScaling,
    ) -> ImaginedRows {
        let (batch, draws) = (&sample.batch, draws(sample));
        let (so, sa) = (self.obs_size, self.action_size);
        let rows = |data, width| rows_of(data, width, &range);
        let mut action = rows(policy, sa).to_vec();
        imagination.add_noise(&mut action, rows(&draws.action, sa));
        let coupling = self.settings.coupling;
        coupling.execute_in_place(&mut action, rows(&batch.previous_action, sa));
        let world = &imagination.world;
        let imagined = world.imagine(rows(&batch.obs, so), rows(obs, so), &action, scaling);
        let values = self.bootstrap(&imagined.next_obs, &action, rows(&draws.smoothing, sa));
        let y_hat = self.backup(&imagined.reward, &imagined.terminated, &values.value);
        ImaginedRows {
            action,
            imagined,
            values,
            y_hat,
        }
    }
}

/// Imaginary transitions with their targets.
pub(super) struct ImaginedRows {
    pub action: Vec<f32>,
    pub imagined: Imagined,
    pub values: Values,
    pub y_hat: Vec<f32>,
}

fn draws(sample: &Sample) -> &ImaginationDraws {
    let draws = sample.model.as_ref().and_then(|m| m.imagination.as_ref());
    draws.expect("an agent that imagines is given draws")
}

impl ImaginaryTargets {
    /// Appends the kept rows to those of the real transitions, which were observed as `observed`.
    pub(super) fn extend(&self, rows: &mut CriticRows, observed: &[f32], batch: &Batch) {
        let (width, sa) = (observed.len() / batch.rows, self.action.len() / batch.rows);
        for &i in &self.kept.rows {
            let observed = &observed[i * width..][..width];
            let action = &self.action[i * sa..][..sa];
            rows.push(observed, action, self.y_hat[i], self.row_weight);
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
