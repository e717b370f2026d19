//! What is added to the critics' update: one trait, one file each.

pub mod expansion;
pub mod imagination;

pub use expansion::{Expansion, ExpansionSettings};
pub use imagination::{Imagination, ImaginationSettings};

use super::Metrics;
use super::core::{ActorCritic, CriticRows, Inputs};
use crate::core::random::{Stream, stream};
use crate::model::{ModelBatch, World};
use crate::nn::{Gradient, LearningState, ObservationScaling, WeightError, rows_of};
use crate::replay::{Batch, ReplayBuffer, Sampler};
use std::ops::Range;

/// What augments the critics' update. Everything that one of them has of its own, noise, settings and memory, is its
/// own business; it reads the core, and adds rows to what the critics are trained on.
pub trait Augment: Send + Sync {
    /// The world that it learns, if any.
    fn learned(&self) -> Option<&Learned>;

    /// The same, to be changed.
    fn learned_mut(&mut self) -> Option<&mut Learned>;

    /// Whether its rows take the place of the real ones with the targets of equation 4.
    fn replaces_targets(&self) -> bool {
        false
    }

    /// Phase 2 begins, before the first update of the core. Returns the bias that the critics are given, if they are.
    fn begin(&mut self, core: &mut ActorCritic, seen: &Phase1) -> Option<f64> {
        let _ = (core, seen);
        None
    }

    /// Whether [`probe`](Augment::probe) has something to tell.
    fn can_probe(&self) -> bool {
        false
    }

    /// Draws the transitions and the noise that its part of the next update needs, for batches of `rows`.
    fn draw(
        &mut self,
        replay: &ReplayBuffer,
        sampler: &dyn Sampler,
        rows: usize,
        action_size: usize,
    ) {
        let _ = action_size;
        if let Some(learned) = self.learned_mut() {
            learned.draw(replay, sampler, rows);
        }
    }

    /// What the rows `range` of the batch drawn for the model add to the gradient of its loss.
    fn differentiate(&self, range: Range<usize>, scaling: &ObservationScaling) -> Option<Gradient> {
        Some(self.learned()?.differentiate(range, scaling))
    }

    /// The step of the model down `gradient`, and the rows that are added to those of the real transitions.
    fn augment(
        &mut self,
        core: &ActorCritic,
        inputs: &Inputs<'_>,
        gradient: Option<Gradient>,
        rows: &mut CriticRows,
        metrics: &mut Metrics,
    );

    /// What it would imagine for the transitions of `batch`, without learning from it, under noise from `rng`; none
    /// for augmentations that imagine no other actions.
    fn probe(
        &self,
        core: &ActorCritic,
        batch: &Batch,
        scaling: &ObservationScaling,
        rng: &mut Stream,
    ) -> Option<Probe> {
        let _ = (core, batch, scaling, rng);
        None
    }

    /// Saves what it goes on from beside the networks.
    fn save_state(&self, state: &mut LearningState) {
        if let Some(learned) = self.learned() {
            learned.save_state(state);
        }
    }

    /// Goes on from what was saved.
    ///
    /// # Errors
    /// When something of it is missing or has another shape.
    fn restore(&mut self, state: &LearningState) -> Result<(), WeightError> {
        match self.learned_mut() {
            Some(learned) => learned.restore(state),
            None => Ok(()),
        }
    }
}

/// What phase 1 has shown.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Phase1 {
    /// `r*`, its largest reward.
    pub largest_reward: f64,
    /// `l`, the steps of the longest episode.
    pub episode_limit: usize,
    /// The discount factor.
    pub discount: f64,
}

impl Phase1 {
    /// `r* l`: the return of an episode of nothing but the largest reward.
    pub fn highest_return(&self) -> f64 {
        self.largest_reward * self.episode_limit as f64
    }

    /// `r* / (1 - gamma)`: the value of nothing but the largest reward for ever, infinite where nothing is discounted.
    pub fn highest_value(&self) -> f64 {
        self.largest_reward / (1.0 - self.discount)
    }
}

/// Imagined steps as they would be learned from, `[n]` rows, to be measured in the simulator.
#[derive(Debug, Clone, PartialEq)]
pub struct Probe {
    /// Executed imaginary actions, `[n, action_size]`.
    pub action: Vec<f32>,
    /// Imagined next observations, scaled, `[n, obs_size]`.
    pub next_obs: Vec<f32>,
    /// Imagined rewards, `[n]`.
    pub reward: Vec<f32>,
    /// Targets of the imagined steps, `[n]`.
    pub y_hat: Vec<f32>,
    /// Indices of the rows that would train the critics, ascending.
    pub kept: Vec<usize>,
    /// The noise of the next actions that the targets were made with, `[n, action_size]`.
    pub next_noise: Vec<f32>,
}

/// Nothing is added: the base algorithm.
pub struct Plain;

impl Augment for Plain {
    fn learned(&self) -> Option<&Learned> {
        None
    }

    fn learned_mut(&mut self) -> Option<&mut Learned> {
        None
    }

    fn augment(
        &mut self,
        _: &ActorCritic,
        _: &Inputs<'_>,
        _: Option<Gradient>,
        _: &mut CriticRows,
        _: &mut Metrics,
    ) {
    }
}

/// A world under training, with the batch that its next step is taken on.
pub struct Learned {
    /// Where actions lead.
    pub world: World,
    batch: Batch,
    rng: Stream,
}

impl Learned {
    /// A world whose batches are drawn from the stream of `seed`.
    pub fn new(world: World, seed: u64) -> Learned {
        Learned {
            world,
            batch: Batch::default(),
            rng: stream(seed, "model-replay"),
        }
    }

    /// Draws the batch of the next step.
    pub fn draw(&mut self, replay: &ReplayBuffer, sampler: &dyn Sampler, rows: usize) {
        self.batch = replay.sample(rows, sampler, &mut self.rng);
    }

    /// Has the next step taken on `batch`.
    pub fn give(&mut self, batch: Batch) {
        self.batch = batch;
    }

    /// What the rows `range` of the batch add to the gradient of the model's loss (equation 5). Every row counts alike,
    /// whatever the sampler's weights: these correct the critics' expectation over transitions, which the model's loss
    /// is none of.
    pub fn differentiate(&self, range: Range<usize>, scaling: &ObservationScaling) -> Gradient {
        let (batch, size) = (&self.batch, scaling.size());
        let obs = scaling.scale(rows_of(&batch.obs, size, &range));
        let next_obs = scaling.scale(rows_of(&batch.next_obs, size, &range));
        let part = ModelBatch {
            obs: &obs,
            action: rows_of(&batch.action, batch.action.len() / batch.rows, &range),
            next_obs: &next_obs,
            reward: &batch.reward[range],
        };
        self.world.model.differentiate(part, batch.rows)
    }

    fn save_state(&self, state: &mut LearningState) {
        self.world.model.save_optimizer(state);
        state.set_stream("model-replay", &self.rng);
    }

    fn restore(&mut self, state: &LearningState) -> Result<(), WeightError> {
        self.rng = state.stream("model-replay")?;
        self.world.model.restore_optimizer(state)
    }
}
