//! Imaginary one-step transitions of the same states by other, noisy actions (paper, section 4, equations 7 to 10).

mod filters;
mod settings;

pub use filters::{Kept, TargetFilter, UncertaintyFilter, keep};
pub use settings::{
    ImaginaryLossMean, ImaginationSettings, OptimisticBias, Readings, TargetComparison,
    UncertaintyScale,
};

use super::{Augment, Learned, Phase1, Probe};
use crate::agent::core::{ActorCritic, CriticRows, Inputs, Values};
use crate::agent::sample::standard_normal;
use crate::agent::{Metrics, Sample};
use crate::core::parallel::{halves, join};
use crate::core::random::{Stream, stream};
use crate::core::span::Span;
use crate::model::{Imagined, World};
use crate::nn::{Gradient, LearningState, ObservationScaling, WeightError, rows_of};
use crate::replay::{Batch, ReplayBuffer, Sampler};
use rand::RngExt;
use std::ops::Range;

/// The paper's augmentation: what actions that the policy might have taken would have led to, in a learned world.
pub struct Imagination {
    learned: Learned,
    /// Deviation of each number's noise before it is clipped.
    deviations: Vec<f32>,
    /// Half of each number's range as a fraction of half of the widest one.
    widths: Vec<f64>,
    /// `eta`, the bound of that noise now, of the number with the widest range.
    noise_bound: f64,
    /// `rho`, what the bound is multiplied by an update; 1 for none.
    decay: f64,
    target_filter: Option<TargetFilter>,
    uncertainty_filter: Option<UncertaintyFilter>,
    loss_mean: ImaginaryLossMean,
    /// What the bias is a part of, and `c`, the part, if the critics start optimistically.
    optimism: Option<(OptimisticBias, f64)>,
    rng: Stream,
    draws: Draws,
    last: ImaginaryTargets,
}

/// Noise of one update's imaginary part.
#[derive(Debug, Clone, Default)]
pub struct Draws {
    /// Standard normal draws of the imaginary actions' noise, `[n, action_size]`.
    pub action: Vec<f32>,
    /// Standard normal draws of the next action at `s_hat`, `[n, action_size]`.
    pub next: Vec<f32>,
    /// Uniform draws in [0, 1) of the uncertainty filter, `[n]`.
    pub keep: Vec<f32>,
}

/// Imaginary transitions and their targets, all `n` rows, whether kept or not.
#[derive(Debug, Clone, Default, PartialEq)]
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

/// Imaginary transitions with their targets, of some rows.
struct Rows {
    action: Vec<f32>,
    imagined: Imagined,
    values: Values,
    y_hat: Vec<f32>,
}

impl Draws {
    /// Draws the noise for `rows` rows.
    fn new(rows: usize, action_size: usize, rng: &mut Stream) -> Draws {
        Draws {
            action: standard_normal(rows * action_size, rng),
            next: standard_normal(rows * action_size, rng),
            keep: (0..rows).map(|_| rng.random::<f32>()).collect(),
        }
    }
}

impl Imagination {
    /// Imagination at the beginning of phase 2 for actions within `ranges`.
    pub fn new(
        settings: &ImaginationSettings,
        ranges: &[Span],
        world: World,
        seed: u64,
    ) -> Imagination {
        let halves = || ranges.iter().map(|range| range.half());
        let widest = halves().fold(0.0, f64::max);
        let deviation = |half: f64| {
            let unit = if settings.noise_relative { half } else { 1.0 };
            (settings.noise_deviation * unit) as f32
        };
        let target = settings.target_filter;
        let uncertainty = settings.uncertainty_filter;
        Imagination {
            learned: Learned::new(world, seed),
            deviations: halves().map(deviation).collect(),
            widths: halves().map(|half| half / widest).collect(),
            noise_bound: settings.noise_bound * widest,
            decay: if settings.noise_decay {
                settings.decay_rate
            } else {
                1.0
            },
            target_filter: target.then_some(TargetFilter(settings.target_comparison)),
            uncertainty_filter: uncertainty
                .then(|| UncertaintyFilter::new(settings.uncertainty_scale)),
            loss_mean: settings.imaginary_loss_mean,
            optimism: settings
                .optimism
                .then_some((settings.bias, settings.bias_factor)),
            rng: stream(seed, "imagination"),
            draws: Draws::default(),
            last: ImaginaryTargets::default(),
        }
    }

    /// Starts from a given noise bound and running maximum of the disagreement.
    pub fn set_progress(&mut self, noise_bound: f64, running_max: f32) {
        self.noise_bound = noise_bound;
        if let Some(filter) = &mut self.uncertainty_filter {
            *filter = filter.at(running_max);
        }
    }

    /// Has the next update made with this noise, and its model step on `batch`.
    pub fn give(&mut self, draws: Draws, batch: Batch) {
        self.draws = draws;
        self.learned.give(batch);
    }

    /// What the last update imagined.
    pub fn last(&self) -> &ImaginaryTargets {
        &self.last
    }

    /// `a_hat = couple(pi(s) + clip(nu, -eta, eta), p)` (equation 7) of the rows `range`, where they lead, and their
    /// targets `y_hat`. `policy` is what the policy does in all rows.
    fn imagine(
        &self,
        core: &ActorCritic,
        inputs: &Inputs<'_>,
        policy: &[f32],
        draws: &Draws,
        range: Range<usize>,
    ) -> Rows {
        let (batch, so, sa) = (&inputs.sample.batch, core.obs_size, core.action_size);
        let rows = |data, width| rows_of(data, width, &range);
        let mut action = rows(policy, sa).to_vec();
        let bounds = self.widths.iter().map(|width| self.noise_bound * width);
        let bounds: Vec<f32> = bounds.map(|bound| bound as f32).collect();
        let noise = rows(&draws.action, sa).chunks_exact(sa);
        for (row, noise) in action.chunks_exact_mut(sa).zip(noise) {
            let figures = self.deviations.iter().zip(&bounds);
            for ((u, z), (deviation, bound)) in row.iter_mut().zip(noise).zip(figures) {
                *u += (deviation * z).clamp(-bound, *bound);
            }
        }
        let coupling = &core.settings.coupling;
        coupling.execute_in_place(&mut action, rows(&batch.previous_action, sa));
        let (raw, obs) = (rows(&batch.obs, so), rows(&inputs.obs, so));
        let imagined = self
            .learned
            .world
            .imagine(raw, obs, &action, inputs.scaling);
        let values = core.bootstrap(&imagined.next_obs, &action, rows(&draws.next, sa));
        let y_hat = core.backup(&imagined.reward, &imagined.terminated, &values.value);
        Rows {
            action,
            imagined,
            values,
            y_hat,
        }
    }

    /// Weight of one kept row's squared error beside `rows` real ones (equation 10).
    fn row_weight(&self, kept: usize, rows: usize) -> f32 {
        match self.loss_mean {
            ImaginaryLossMean::Kept => 1.0 / kept.max(1) as f32,
            ImaginaryLossMean::Batch => 1.0 / rows as f32,
        }
    }
}

impl Augment for Imagination {
    fn learned(&self) -> Option<&Learned> {
        Some(&self.learned)
    }

    fn learned_mut(&mut self) -> Option<&mut Learned> {
        Some(&mut self.learned)
    }

    /// `b = r* l c` (equation 6), or `b = c r* / (1 - gamma)`.
    fn begin(&mut self, core: &mut ActorCritic, seen: &Phase1) -> Option<f64> {
        let (bias, factor) = self.optimism?;
        let most = match bias {
            OptimisticBias::Return => seen.highest_return(),
            OptimisticBias::Value => seen.highest_value(),
        };
        let bias = most * factor;
        core.set_optimism(bias as f32);
        Some(bias)
    }

    fn can_probe(&self) -> bool {
        true
    }

    fn draw(
        &mut self,
        replay: &ReplayBuffer,
        sampler: &dyn Sampler,
        rows: usize,
        action_size: usize,
    ) {
        self.learned.draw(replay, sampler, rows);
        self.draws = Draws::new(rows, action_size, &mut self.rng);
    }

    fn augment(
        &mut self,
        core: &ActorCritic,
        inputs: &Inputs<'_>,
        gradient: Option<Gradient>,
        rows: &mut CriticRows,
        metrics: &mut Metrics,
    ) {
        let batch = &inputs.sample.batch;
        let n = batch.rows;
        // What the policy does in the batch's states does not need the model.
        let model = &mut self.learned.world.model;
        let ((), policy) = join(
            || {
                gradient
                    .into_iter()
                    .for_each(|gradient| model.step(gradient))
            },
            || core.output(&inputs.observed),
        );
        let read = &*self;
        let half = |range| read.imagine(core, inputs, &policy, &read.draws, range);
        let [first, second] = halves(n, half);
        let action = [first.action, second.action].concat();
        let y_hat = [first.y_hat, second.y_hat].concat();
        let disagreement = [first.values.disagreement, second.values.disagreement].concat();

        // Equations 8 and 9; the real targets are those of the first rows.
        let (target, uncertainty) = (self.target_filter, self.uncertainty_filter.as_mut());
        let (y, uniform) = (&rows.y[..n], &self.draws.keep);
        let kept = keep(target, uncertainty, &y_hat, y, &disagreement, uniform);

        // Equation 10: kept rows beside the real ones.
        let weight = self.row_weight(kept.rows.len(), n);
        let (width, sa) = (core.observed_width(), core.action_size);
        for &i in &kept.rows {
            let observed = &inputs.observed[i * width..][..width];
            let weight = weight * batch.weight(i);
            rows.push(observed, &action[i * sa..][..sa], y_hat[i], weight);
        }

        let fraction = |count: usize| count as f64 / n as f64;
        metrics.set("eta", self.noise_bound);
        metrics.set("target_kept", fraction(kept.by_target));
        metrics.set("uncertainty_kept", fraction(kept.by_uncertainty));
        metrics.set("kept", fraction(kept.rows.len()));
        self.last = ImaginaryTargets {
            action,
            y_hat,
            disagreement,
            kept,
            noise_bound: self.noise_bound,
        };
        // Algorithm 1, line 20: the bound shrinks, the deviation stays.
        self.noise_bound *= self.decay;
    }

    fn probe(
        &self,
        core: &ActorCritic,
        batch: &Batch,
        scaling: &ObservationScaling,
        rng: &mut Stream,
    ) -> Option<Probe> {
        let (n, sa) = (batch.rows, core.action_size);
        let draws = Draws::new(n, sa, rng);
        let sample = Sample {
            batch: batch.clone(),
            next_noise: standard_normal(n * sa, rng),
            actor_noise: Vec::new(),
        };
        let inputs = core.inputs(&sample, scaling);
        let policy = core.output(&inputs.observed);
        let y = core.real_targets(&inputs, 0..n);
        let rows = self.imagine(core, &inputs, &policy, &draws, 0..n);
        // A copy of the filter: a look must not move its running maximum.
        let mut uncertainty = self.uncertainty_filter;
        let kept = keep(
            self.target_filter,
            uncertainty.as_mut(),
            &rows.y_hat,
            &y,
            &rows.values.disagreement,
            &draws.keep,
        );
        Some(Probe {
            action: rows.action,
            next_obs: rows.imagined.next_obs,
            reward: rows.imagined.reward,
            y_hat: rows.y_hat,
            kept: kept.rows,
            next_noise: draws.next,
        })
    }

    fn save_state(&self, state: &mut LearningState) {
        self.learned.save_state(state);
        state.set_stream("imagination", &self.rng);
        state.set("noise_bound", self.noise_bound);
        let running_max = self.uncertainty_filter.map_or(0.0, |f| f.running_max());
        state.set("running_max", running_max.into());
    }

    fn restore(&mut self, state: &LearningState) -> Result<(), WeightError> {
        self.learned.restore(state)?;
        self.rng = state.stream("imagination")?;
        let noise_bound = state.number("noise_bound")?;
        let running_max = state.number("running_max")? as f32;
        self.set_progress(noise_bound, running_max);
        Ok(())
    }
}
