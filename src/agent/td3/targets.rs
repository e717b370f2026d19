//! What the critics are trained towards: real and imaginary targets.

use super::{Td3, model_gradient};
use crate::agent::Sample;
use crate::imagination::{Imagination, Kept};
use crate::nn::{Gradient, ObservationScaling, rows_of, side_by_side};
use crate::parallel::{halves, join};
use std::ops::Range;

/// What the critics of one update are trained towards.
#[derive(Debug, Clone, PartialEq)]
pub struct Targets {
    /// What actor and critics see of the batch, scaled (`Coupling::observe`), row by row.
    pub observed: Vec<f32>,
    /// Real targets `y` (equation 4), `[n]`.
    pub y: Vec<f32>,
    /// Of agents that imagine.
    pub imaginary: Option<ImaginaryTargets>,
    /// Loss of the model's step (equation 5), of agents that have a model.
    pub model_loss: Option<f32>,
}

/// The imaginary part of [`Targets`], all rows, whether kept or not.
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
    /// Bound `eta` that the actions' noise was clipped to.
    pub noise_bound: f64,
}

/// Values of a policy's next step by the target networks.
struct Bootstrap {
    /// `min(Q1', Q2')`.
    value: Vec<f32>,
    /// `|Q1' - Q2'|`.
    disagreement: Vec<f32>,
}

impl Td3 {
    /// The model's step and the targets of both kinds (Algorithm 1, lines 18 to 21).
    pub fn prepare(&mut self, sample: &Sample, scaling: &ObservationScaling) -> Targets {
        let batch = &sample.batch;
        let obs = scaling.scale(&batch.obs);
        let observed = self.observe(&obs, &batch.previous_action);

        // The real targets don't need the model: each thread takes half of both.
        let mut imagination = self.imagination.take();
        let imagining = imagination.as_ref().zip(sample.imagination.as_ref());
        let [first, second] = halves(batch.rows, |range| {
            let gradient = imagining.map(|(imagination, draws)| {
                let model = &imagination.model;
                model_gradient(model, &draws.model_batch, range.clone(), scaling)
            });
            (gradient, self.real_targets(sample, range, scaling))
        });
        let y = [first.1, second.1].concat();
        let gradient = first
            .0
            .zip(second.0)
            .map(|(first, second)| Gradient::sum([first, second]));

        let model_loss = gradient.as_ref().map(Gradient::loss);
        let imaginary = imagination
            .as_mut()
            .zip(gradient)
            .map(|(imagination, gradient)| {
                let ((), policy) = join(
                    || imagination.model.step(gradient),
                    || self.actor.mlp().forward(&observed),
                );
                self.imaginary_targets(imagination, sample, &obs, &policy, &y, scaling)
            });
        self.imagination = imagination;
        Targets {
            observed,
            y,
            imaginary,
            model_loss,
        }
    }

    /// `y = r + gamma (1 - d) min(Q1', Q2')(s', a')` (equation 4) of the rows `range`.
    fn real_targets(
        &self,
        sample: &Sample,
        range: Range<usize>,
        scaling: &ObservationScaling,
    ) -> Vec<f32> {
        let (batch, sa) = (&sample.batch, self.action_size);
        let next = scaling.scale(rows_of(&batch.next_obs, self.obs_size, &range));
        let action = rows_of(&batch.action, sa, &range);
        let bootstrap = self.bootstrap(&next, action, rows_of(&sample.smoothing, sa, &range));
        let (reward, terminated) = (&batch.reward[range.clone()], &batch.terminated[range]);
        self.backup(reward, terminated, &bootstrap.value)
    }

    /// Imaginary actions, where they lead, their targets and which of them are kept (equations 7
    /// to 9). `policy` is what the online actor's network gives for the batch.
    fn imaginary_targets(
        &self,
        imagination: &mut Imagination,
        sample: &Sample,
        obs: &[f32],
        policy: &[f32],
        y: &[f32],
        scaling: &ObservationScaling,
    ) -> ImaginaryTargets {
        let batch = &sample.batch;
        let draws = sample
            .imagination
            .as_ref()
            .expect("an agent that imagines is given draws");
        let noise_bound = imagination.noise_bound();
        let (so, sa) = (self.obs_size, self.action_size);
        let coupling = self.settings.coupling;

        let half = |range: Range<usize>| {
            let rows = |data, width| rows_of(data, width, &range);
            let mut action = rows(policy, sa).to_vec();
            coupling.output_in_place(&mut action);
            let bound = noise_bound as f32;
            for (u, z) in action.iter_mut().zip(rows(&draws.action, sa)) {
                *u += z.clamp(-bound, bound);
            }
            coupling.execute_in_place(&mut action, rows(&batch.previous_action, sa));
            let imagined =
                imagination.imagine(rows(&batch.obs, so), rows(obs, so), &action, scaling);
            let bootstrap = self.bootstrap(&imagined.next_obs, &action, rows(&draws.smoothing, sa));
            let y_hat = self.backup(&imagined.reward, &imagined.terminated, &bootstrap.value);
            (action, y_hat, bootstrap.disagreement)
        };
        let [first, second] = halves(batch.rows, half);
        let action = [first.0, second.0].concat();
        let y_hat = [first.1, second.1].concat();
        let disagreement = [first.2, second.2].concat();
        imagination.decay_noise();
        let kept = imagination.filter(&y_hat, y, &disagreement, &draws.keep);
        ImaginaryTargets {
            action,
            y_hat,
            disagreement,
            kept,
            noise_bound,
        }
    }

    /// Target critics at the smoothed action of the target actor in `next_obs` (scaled), reached
    /// by `action`; `noise` is standard normal.
    fn bootstrap(&self, next_obs: &[f32], action: &[f32], noise: &[f32]) -> Bootstrap {
        let coupling = self.settings.coupling;
        let limit = coupling.limit as f32;
        let deviation = self.settings.smoothing.deviation as f32 * limit;
        let clip = self.settings.smoothing.clip as f32 * limit;

        let observed = self.observe(next_obs, action);
        let width = coupling.observed_width(self.obs_size, self.action_size);
        let mut next_action = self.target_actor.forward(&observed);
        coupling.output_in_place(&mut next_action);
        for (u, z) in next_action.iter_mut().zip(noise) {
            *u = (*u + (deviation * z).clamp(-clip, clip)).clamp(-limit, limit);
        }
        coupling.execute_in_place(&mut next_action, action);

        let input = side_by_side(&[(&observed, width), (&next_action, self.action_size)]);
        let [q1, q2] = self
            .target_critics
            .each_ref()
            .map(|critic| critic.forward(&input));
        let pairs = || q1.iter().zip(&q2);
        Bootstrap {
            value: pairs().map(|(a, b)| a.min(*b)).collect(),
            disagreement: pairs().map(|(a, b)| (a - b).abs()).collect(),
        }
    }

    /// `r + gamma (1 - d) value`.
    fn backup(&self, reward: &[f32], terminated: &[f32], value: &[f32]) -> Vec<f32> {
        let discount = self.settings.discount as f32;
        let rows = reward.iter().zip(terminated).zip(value);
        rows.map(|((r, d), v)| r + discount * (1.0 - d) * v)
            .collect()
    }
}
