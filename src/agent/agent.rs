//! An agent: actor and critics, and what augments their update.

use super::augment::Augment;
use super::sample::SampleStreams;
use super::{ActorCritic, CriticRows, Metrics, Policy, Recorded, Sample};
use crate::core::parallel::{halves, join};
use crate::nn::{Gradient, LearningState, ObservationScaling, WeightError, Weights};
use crate::replay::{Batch, ReplayBuffer, Sampler};

/// A point of the space base algorithm x augmentation: TD3 with imagination is MAMF (paper, Algorithm 1).
pub struct Agent {
    /// Actor and critics.
    pub core: ActorCritic,
    /// What is added to the critics' update.
    pub augment: Box<dyn Augment>,
    /// Recorded transitions that have a share in every batch.
    pub recorded: Option<Recorded>,
    streams: SampleStreams,
}

/// What the critics of one update are trained towards.
#[derive(Debug, Clone, PartialEq)]
pub struct Targets {
    /// What actor and critics see of the batch, scaled, `[n, width]`.
    pub observed: Vec<f32>,
    /// The rows that train the critics: the `n` real ones first, then what augments them.
    pub rows: CriticRows,
    /// What was told on the way.
    pub metrics: Metrics,
}

/// What an update tells.
#[derive(Debug, Clone, PartialEq)]
pub struct Update {
    /// Loss of each critic before its step (equation 10).
    pub critic_losses: Vec<f32>,
    /// Largest absolute error of the critics before their step on each real row, `[n]`.
    pub errors: Vec<f32>,
    /// Mean of `|Q1|` over the real rows, before the critics' step.
    pub value_scale: f32,
    /// Whether the actor took a step.
    pub actor_changed: bool,
    /// Numbers by name.
    pub metrics: Metrics,
}

/// All targets of an update, and the step of the dynamics model (Algorithm 1, lines 18 to 21).
pub fn targets(
    core: &ActorCritic,
    augment: &mut dyn Augment,
    sample: &Sample,
    scaling: &ObservationScaling,
) -> Targets {
    let inputs = core.inputs(sample, scaling);
    let batch = &sample.batch;
    // The real targets don't need the model's step: each thread takes half of both.
    let (reading, needs_real) = (&*augment, !augment.replaces_targets());
    let [first, second] = halves(batch.rows, |range| {
        let gradient = reading.differentiate(range.clone(), scaling);
        let y = needs_real.then(|| core.real_targets(&inputs, range));
        (gradient, y.unwrap_or_default())
    });
    let gradient = first.0.zip(second.0);
    let gradient = gradient.map(|(first, second)| Gradient::sum([first, second]));

    let mut metrics = Metrics::default();
    if let Some(gradient) = &gradient {
        metrics.set("model_loss", gradient.loss());
    }
    let mut rows = CriticRows::default();
    if needs_real {
        let mut y = [first.1, second.1].concat();
        // What was done once can be done again.
        for (y, attained) in y[batch.recorded_rows()].iter_mut().zip(&batch.attained) {
            *y = y.max(*attained);
        }
        rows.extend_real(&inputs.observed, batch, &y);
    }
    augment.augment(core, &inputs, gradient, &mut rows, &mut metrics);
    Targets {
        observed: inputs.observed,
        rows,
        metrics,
    }
}

impl Agent {
    /// An agent of these parts, whose samples are drawn from the streams of `seed`.
    pub fn new(core: ActorCritic, augment: Box<dyn Augment>, seed: u64) -> Agent {
        Agent {
            core,
            augment,
            recorded: None,
            streams: SampleStreams::new(seed),
        }
    }

    /// Transitions and noise of the next update, `rows` rows; the augmentation keeps what it needs besides.
    pub fn draw(&mut self, replay: &ReplayBuffer, sampler: &dyn Sampler, rows: usize) -> Sample {
        let action_size = self.core.action_size;
        let stochastic = self.core.settings.base.is_stochastic();
        let (streams, augment) = (&mut self.streams, &mut self.augment);
        let recorded = self.recorded.as_mut();
        let (sample, ()) = join(
            || streams.draw(replay, sampler, recorded, rows, action_size, stochastic),
            || augment.draw(replay, sampler, rows, action_size),
        );
        sample
    }

    /// One update: model, critics, and when they are due actor and targets (Algorithm 1, lines 18 to 26).
    pub fn update(&mut self, sample: &Sample, scaling: &ObservationScaling) -> Update {
        let targets = targets(&self.core, self.augment.as_mut(), sample, scaling);
        let rows = sample.batch.rows;
        let mut update = self.core.step_critics(targets.rows, rows, targets.metrics);
        self.core
            .step_actor_if_due(sample, &targets.observed, &mut update);
        update
    }

    /// As [`update`](Agent::update), of model and critics alone.
    pub fn update_critics(&mut self, sample: &Sample, scaling: &ObservationScaling) -> Update {
        let targets = targets(&self.core, self.augment.as_mut(), sample, scaling);
        let rows = sample.batch.rows;
        self.core.step_critics(targets.rows, rows, targets.metrics)
    }

    /// One step of the dynamics model alone (phase 1) on a batch of its own. Returns its loss; none without a model.
    pub fn train_model(
        &mut self,
        replay: &ReplayBuffer,
        sampler: &dyn Sampler,
        rows: usize,
        scaling: &ObservationScaling,
    ) -> Option<f32> {
        let learned = self.augment.learned_mut()?;
        learned.draw(replay, sampler, rows);
        let reading = &*learned;
        let gradient = Gradient::sum(halves(rows, |range| reading.differentiate(range, scaling)));
        let loss = gradient.loss();
        learned.world.model.step(gradient);
        Some(loss)
    }

    /// Root mean square one-step error of the dynamics model on `batch`, in scaled space; none without a model.
    pub fn model_error(&self, batch: &Batch, scaling: &ObservationScaling) -> Option<f32> {
        let model = &self.augment.learned()?.world.model;
        let (obs, next) = (scaling.scale(&batch.obs), scaling.scale(&batch.next_obs));
        Some(model.error(&obs, &batch.action, &next).sqrt())
    }

    /// The current policy under `scaling`.
    pub fn policy(&self, scaling: &ObservationScaling) -> Policy {
        let settings = &self.core.settings;
        let actor = self.core.actor().clone();
        Policy::new(
            actor,
            settings.base,
            scaling.clone(),
            settings.coupling.clone(),
        )
    }

    /// All networks by name: `actor`, `critic1`, `critic2`, their targets `target_actor` and so on as far as the base
    /// has them, `model`, and SAC's `log_temperature`.
    pub fn weights(&self) -> Weights {
        let mut weights = Weights::default();
        self.core.save(&mut weights);
        if let Some(learned) = self.augment.learned() {
            learned.world.model.save(&mut weights);
        }
        weights
    }

    /// Name of a network of which a parameter, or its second moment, was not finite after some step.
    pub fn not_finite(&self) -> Option<&'static str> {
        let model = self.augment.learned().map(|learned| &learned.world.model);
        let model = model.is_some_and(|model| !model.is_finite());
        self.core.not_finite().or(model.then_some("model"))
    }

    /// What training goes on from beside the [`weights`](Agent::weights): the moments of all optimisers, counters,
    /// random streams, and what the augmentation carries along.
    pub fn state(&self) -> LearningState {
        let mut state = LearningState::default();
        self.streams.save_state(&mut state);
        if let Some(recorded) = &self.recorded {
            recorded.save_state(&mut state);
        }
        self.core.save_state(&mut state);
        self.augment.save_state(&mut state);
        state
    }

    /// Goes on from `state`, to the last bit as the agent would have that it was taken of, if the networks are that
    /// agent's.
    ///
    /// # Errors
    /// When something is missing or has another shape than the settings say.
    pub fn restore(&mut self, state: &LearningState) -> Result<(), WeightError> {
        self.streams.restore(state)?;
        if let Some(recorded) = &mut self.recorded {
            recorded.restore(state)?;
        }
        self.core.restore(state)?;
        self.augment.restore(state)
    }
}
