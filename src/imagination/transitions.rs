//! Imaginary one-step transitions (paper, equation 7).

use super::{
    DynamicsModel, ImaginaryLossMean, ImaginationSettings, Kept, NoiseBound, TargetFilter,
    UncertaintyFilter, keep,
};
use crate::env::Rules;
use crate::nn::ObservationScaling;
use std::sync::Arc;

/// Everything an agent needs to imagine: the model, what the designer knows, noise and filters.
pub struct Imagination {
    /// The learned dynamics.
    pub model: DynamicsModel,
    rules: Arc<dyn Rules>,
    noise: NoiseBound,
    target_filter: Option<TargetFilter>,
    uncertainty_filter: Option<UncertaintyFilter>,
    loss_mean: ImaginaryLossMean,
}

/// Where the imaginary actions lead: `s_hat` in scaled space, `r_hat` and `d_hat`.
#[derive(Debug, Clone, PartialEq)]
pub struct Imagined {
    /// `s_hat`, scaled and clipped, `[n, obs_size]`.
    pub next_obs: Vec<f32>,
    /// `r_hat`, `[n]`.
    pub reward: Vec<f32>,
    /// `d_hat`, `[n]`, 1 or 0.
    pub terminated: Vec<f32>,
}

impl Imagination {
    /// Imagination at the beginning of phase 2 for actions within `action_limit`.
    pub fn new(
        settings: &ImaginationSettings,
        action_limit: f64,
        model: DynamicsModel,
        rules: Arc<dyn Rules>,
    ) -> Imagination {
        let rate = if settings.noise_decay {
            settings.decay_rate
        } else {
            1.0
        };
        Imagination {
            model,
            rules,
            noise: NoiseBound::new(action_limit, rate),
            target_filter: settings
                .target_filter
                .then_some(TargetFilter(settings.target_comparison)),
            uncertainty_filter: settings
                .uncertainty_filter
                .then_some(UncertaintyFilter::new(settings.uncertainty_scale)),
            loss_mean: settings.imaginary_loss_mean,
        }
    }

    /// Starts from a given noise bound and running maximum of the disagreement.
    pub fn with_progress(mut self, noise_bound: f64, running_max: f32) -> Imagination {
        self.noise = self.noise.at(noise_bound);
        if let Some(filter) = &mut self.uncertainty_filter {
            *filter = filter.at(running_max);
        }
        self
    }

    /// `eta`, the bound of the action noise, now.
    pub fn noise_bound(&self) -> f64 {
        self.noise.bound()
    }

    /// Passes to the next update: `eta <- eta rho`.
    pub fn decay_noise(&mut self) {
        self.noise.decay();
    }

    /// Largest disagreement of the target critics since phase 2 began; 0 without that filter.
    pub fn running_max(&self) -> f32 {
        self.uncertainty_filter
            .map_or(0.0, |filter| filter.running_max())
    }

    /// Where `action` (executed, `[n, action_size]`) leads from `obs` (as observed) alias
    /// `scaled_obs`, `[n, obs_size]` each, under `scaling`.
    ///
    /// The rules see unscaled observations; what they know replaces what the model says of it.
    pub fn imagine(
        &self,
        obs: &[f32],
        scaled_obs: &[f32],
        action: &[f32],
        scaling: &ObservationScaling,
    ) -> Imagined {
        let rows = obs.len() / scaling.size();
        let mut next = self.model.predict(scaled_obs, action);
        scaling.unscale(&mut next);
        self.rules.complete_batch(obs, action, &mut next, rows);
        let mut reward = vec![0.0; rows];
        self.rules.reward_batch(obs, action, &next, &mut reward);
        let mut terminated = vec![0.0; rows];
        self.rules.terminated_batch(&next, &mut terminated);
        Imagined {
            next_obs: scaling.scale(&next),
            reward,
            terminated,
        }
    }

    /// Which rows train the critics; see [`keep`].
    pub fn filter(
        &mut self,
        y_hat: &[f32],
        y: &[f32],
        disagreement: &[f32],
        uniform: &[f32],
    ) -> Kept {
        keep(
            self.target_filter,
            self.uncertainty_filter.as_mut(),
            y_hat,
            y,
            disagreement,
            uniform,
        )
    }

    /// Weight of one kept row's squared error beside `rows` real ones (equation 10).
    pub fn row_weight(&self, kept: usize, rows: usize) -> f32 {
        match self.loss_mean {
            ImaginaryLossMean::Kept => 1.0 / kept.max(1) as f32,
            ImaginaryLossMean::Batch => 1.0 / rows as f32,
        }
    }
}
