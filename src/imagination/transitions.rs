//! Imaginary one-step transitions with noisy actions (paper, equations 7 to 10).

use crate::nn::{Memory, WeightError};

use super::{
    ImaginaryLossMean, ImaginationSettings, Kept, NoiseBound, TargetFilter, UncertaintyFilter,
    World, keep,
};

/// Everything an agent needs to imagine other actions: the world, noise and filters.
pub struct Imagination {
    /// Where actions lead.
    pub world: World,
    deviation: f64,
    noise: NoiseBound,
    /// Which imaginary rows train the critics.
    pub filters: Filters,
    loss_mean: ImaginaryLossMean,
}

/// The filters that are switched on, and what they remember.
#[derive(Debug, Clone, Copy)]
pub struct Filters {
    target: Option<TargetFilter>,
    uncertainty: Option<UncertaintyFilter>,
}

impl Filters {
    /// Which rows train the critics; see [`keep`].
    pub fn keep(
        &mut self,
        y_hat: &[f32],
        y: &[f32],
        disagreement: &[f32],
        uniform: &[f32],
    ) -> Kept {
        let uncertainty = self.uncertainty.as_mut();
        keep(self.target, uncertainty, y_hat, y, disagreement, uniform)
    }
}

impl Imagination {
    /// Imagination at the beginning of phase 2 for actions within `action_limit`.
    pub fn new(settings: &ImaginationSettings, action_limit: f64, world: World) -> Imagination {
        let rate = if settings.noise_decay {
            settings.decay_rate
        } else {
            1.0
        };
        let unit = if settings.noise_relative {
            action_limit
        } else {
            1.0
        };
        Imagination {
            world,
            deviation: settings.noise_deviation * unit,
            noise: NoiseBound::new(settings.noise_bound * action_limit, rate),
            filters: Filters {
                target: settings
                    .target_filter
                    .then_some(TargetFilter(settings.target_comparison)),
                uncertainty: settings
                    .uncertainty_filter
                    .then_some(UncertaintyFilter::new(settings.uncertainty_scale)),
            },
            loss_mean: settings.imaginary_loss_mean,
        }
    }

    /// Starts from a given noise bound and running maximum of the disagreement.
    pub fn with_progress(mut self, noise_bound: f64, running_max: f32) -> Imagination {
        self.set_progress(noise_bound, running_max);
        self
    }

    /// Remembers the noise bound and the running maximum.
    pub fn remember(&self, memory: &mut Memory) {
        memory.set("noise_bound", self.noise_bound());
        memory.set("running_max", self.running_max().into());
    }

    /// Goes on from what was remembered.
    ///
    /// # Errors
    /// When something of it is missing.
    pub fn restore(&mut self, memory: &Memory) -> Result<(), WeightError> {
        let bound = memory.number("noise_bound")?;
        let running_max = memory.number("running_max")? as f32;
        self.set_progress(bound, running_max);
        Ok(())
    }

    fn set_progress(&mut self, noise_bound: f64, running_max: f32) {
        self.noise = self.noise.at(noise_bound);
        if let Some(filter) = &mut self.filters.uncertainty {
            *filter = filter.at(running_max);
        }
    }

    /// `eta`, the bound of the action noise, now.
    pub fn noise_bound(&self) -> f64 {
        self.noise.bound()
    }

    /// Adds the noise of equation 7 to the policy's output; `z` is standard normal.
    pub fn add_noise(&self, output: &mut [f32], z: &[f32]) {
        let (deviation, bound) = (self.deviation as f32, self.noise.bound() as f32);
        for (u, z) in output.iter_mut().zip(z) {
            *u += (deviation * z).clamp(-bound, bound);
        }
    }

    /// Passes to the next update: `eta <- eta rho`.
    pub fn decay_noise(&mut self) {
        self.noise.decay();
    }

    /// Largest disagreement of the target critics since phase 2 began; 0 without that filter.
    pub fn running_max(&self) -> f32 {
        let filter = self.filters.uncertainty;
        filter.map_or(0.0, |filter| filter.running_max())
    }

    /// Weight of one kept row's squared error beside `rows` real ones (equation 10).
    pub fn row_weight(&self, kept: usize, rows: usize) -> f32 {
        match self.loss_mean {
            ImaginaryLossMean::Kept => 1.0 / kept.max(1) as f32,
            ImaginaryLossMean::Batch => 1.0 / rows as f32,
        }
    }
}
