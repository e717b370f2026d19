//! An agent: a base algorithm, its critics, and what is added to their update.

use super::base::{self, ActorBatch, Base};
use super::critics::Critics;
use super::{
    AgentSettings, Augmentation, ExpandedTargets, Figures, ImaginaryTargets, Policy, Sample,
};
use crate::imagination::{DynamicsModel, ModelBatch};
use crate::nn::{Gradient, Memory, Mlp, ObservationScaling, WeightError, Weights, rows_of};
use crate::parallel::{halves, join};
use crate::random::Stream;
use crate::replay::Batch;
use burn::tensor::Device;
use std::ops::Range;

/// A point of the space base algorithm x augmentation: TD3 with imagination is MAMF (paper,
/// Algorithm 1, lines 18 to 26).
pub struct Agent {
    pub(super) settings: AgentSettings,
    pub(super) obs_size: usize,
    pub(super) action_size: usize,
    pub(super) base: Box<dyn Base>,
    pub(super) critics: Critics,
    augmentation: Augmentation,
    updates: u64,
}

/// What an augmentation sees of an update.
pub(super) struct Seen<'a> {
    /// Transitions and noise.
    pub sample: &'a Sample,
    /// Observations of the batch, scaled, `[n, obs_size]`.
    pub obs: &'a [f32],
    /// How next observations are scaled.
    pub scaling: &'a ObservationScaling,
}

/// What the critics of one update are trained towards.
#[derive(Debug, Clone, PartialEq)]
pub struct Targets {
    /// What actor and critics see of the batch, scaled (`Coupling::observe`), row by row.
    pub observed: Vec<f32>,
    /// Targets `y` of the real transitions, `[n]`: equation 4, or those of an expansion.
    pub y: Vec<f32>,
    /// Of agents that imagine.
    pub imaginary: Option<ImaginaryTargets>,
    /// Of agents that expand.
    pub expanded: Option<ExpandedTargets>,
    /// Loss of the model's step (equation 5), of agents that have a model.
    pub model_loss: Option<f32>,
}

impl Agent {
    /// A fresh agent trained on `device`; networks are drawn from `rng`.
    pub fn new(
        settings: AgentSettings,
        obs_size: usize,
        action_size: usize,
        augmentation: Augmentation,
        rng: &mut Stream,
        device: &Device,
    ) -> Agent {
        let actor = Mlp::new(&settings.actor_widths(obs_size, action_size), rng);
        let widths = settings.critic_widths(obs_size, action_size);
        Agent {
            critics: Critics::new(&settings, &widths, rng, device),
            base: base::fresh(&settings, actor, device),
            settings,
            obs_size,
            action_size,
            augmentation,
            updates: 0,
        }
    }

    /// An agent with saved networks, without its optimisers' moments.
    ///
    /// # Errors
    /// When an array is missing or has another shape than the settings say.
    pub fn load(
        settings: AgentSettings,
        obs_size: usize,
        action_size: usize,
        augmentation: Augmentation,
        weights: &Weights,
        device: &Device,
    ) -> Result<Agent, WeightError> {
        let actor_widths = settings.actor_widths(obs_size, action_size);
        let critic_widths = settings.critic_widths(obs_size, action_size);
        Ok(Agent {
            base: base::load(&settings, &actor_widths, weights, device)?,
            critics: Critics::load(&settings, &critic_widths, weights, device)?,
            settings,
            obs_size,
            action_size,
            augmentation,
            updates: 0,
        })
    }

    /// All networks by name: `actor`, `critic1`, `critic2`, their targets `target_actor` and so on as
    /// far as the base has them, `model`, and SAC's `log_temperature`.
    pub fn weights(&self) -> Weights {
        let mut weights = Weights::default();
        self.base.save(&mut weights);
        self.critics.save(&mut weights);
        if let Some(world) = self.augmentation.world() {
            world.model.save(&mut weights);
        }
        weights
    }

    /// Name of a network of which a parameter, or its second moment, was not finite after some step.
    pub fn not_finite(&self) -> Option<&'static str> {
        let world = self.augmentation.world();
        let networks = [
            ("actor", self.base.is_finite()),
            ("critics", self.critics.are_finite()),
            ("model", world.is_none_or(|world| world.model.is_finite())),
        ];
        let wrong = networks.into_iter().find(|(_, finite)| !finite);
        wrong.map(|(name, _)| name)
    }

    /// What training goes on from beside the [`weights`](Agent::weights): the moments of all optimisers,
    /// counters, and what imagination remembers.
    pub fn memory(&self) -> Memory {
        let mut memory = Memory::default();
        memory.set("updates", self.updates as f64);
        self.base.remember(&mut memory);
        self.critics.save_optimizers(&mut memory);
        self.augmentation.remember(&mut memory);
        memory
    }

    /// Goes on from `memory`, to the last bit as the agent would have that it was taken of, if the
    /// networks are that agent's ([`load`](Agent::load)).
    ///
    /// # Errors
    /// When something is missing or has another shape than the settings say.
    pub fn restore(&mut self, memory: &Memory) -> Result<(), WeightError> {
        self.updates = memory.count("updates")?;
        self.base.restore(memory)?;
        self.critics.restore_optimizers(memory)?;
        self.augmentation.restore(memory)
    }

    /// The current policy under `scaling`.
    pub fn policy(&self, scaling: &ObservationScaling) -> Policy {
        Policy::new(
            self.base.actor().clone(),
            self.settings.base,
            scaling.clone(),
            self.settings.coupling,
        )
    }

    /// What is added to the critics' update.
    pub fn augmentation(&self) -> &Augmentation {
        &self.augmentation
    }

    /// Optimistic start: `bias` becomes the output bias of all critics and their targets
    /// (equation 6). To be used once, before the first update.
    pub fn set_optimism(&mut self, bias: f32) {
        self.critics.set_output_bias(bias);
    }

    /// One step of the dynamics model alone (phase 1). Returns its loss; none without a model.
    pub fn train_model(&mut self, batch: &Batch, scaling: &ObservationScaling) -> Option<f32> {
        let model = &mut self.augmentation.world_mut()?.model;
        let gradient = Gradient::sum(halves(batch.rows, |range| {
            model_gradient(model, batch, range, scaling)
        }));
        let loss = gradient.loss();
        model.step(gradient);
        Some(loss)
    }

    /// Root mean square one-step error of the dynamics model on `batch`, in scaled space.
    pub fn model_error(&self, batch: &Batch, scaling: &ObservationScaling) -> Option<f32> {
        let model = &self.augmentation.world()?.model;
        let (obs, next) = (scaling.scale(&batch.obs), scaling.scale(&batch.next_obs));
        Some(model.error(&obs, &batch.action, &next).sqrt())
    }

    /// One step of phase 2: model, critics, and every `policy_delay` updates actor and targets.
    pub fn update(&mut self, sample: &Sample, scaling: &ObservationScaling) -> Figures {
        let targets = self.prepare(sample, scaling);
        self.learn(sample, &targets)
    }

    /// As [`update`](Agent::update), without the actor's part.
    pub fn update_critics(&mut self, sample: &Sample, scaling: &ObservationScaling) -> Figures {
        let targets = self.prepare(sample, scaling);
        self.learn_critics(sample, &targets)
    }

    /// The model's step and all targets (Algorithm 1, lines 18 to 21).
    pub fn prepare(&mut self, sample: &Sample, scaling: &ObservationScaling) -> Targets {
        // Taken out while the rest of the agent is read.
        let mut augmentation = std::mem::replace(&mut self.augmentation, Augmentation::None);
        let targets = self.prepare_with(&mut augmentation, sample, scaling);
        self.augmentation = augmentation;
        targets
    }

    fn prepare_with(
        &self,
        augmentation: &mut Augmentation,
        sample: &Sample,
        scaling: &ObservationScaling,
    ) -> Targets {
        let batch = &sample.batch;
        let obs = scaling.scale(&batch.obs);
        let observed = self.observe(&obs, &batch.previous_action);

        // The real targets don't need the model: each thread takes half of both.
        let modelling = augmentation.world().zip(sample.model.as_ref());
        let needs_real = !augmentation.replaces_targets();
        let [first, second] = halves(batch.rows, |range| {
            let gradient = modelling.map(|(world, draws)| {
                model_gradient(&world.model, &draws.batch, range.clone(), scaling)
            });
            let y = if needs_real {
                self.real_targets(sample, range, scaling)
            } else {
                Vec::new()
            };
            (gradient, y)
        });
        let gradients = first.0.zip(second.0);
        let gradient = gradients.map(|(first, second)| Gradient::sum([first, second]));
        let mut targets = Targets {
            observed,
            y: [first.1, second.1].concat(),
            imaginary: None,
            expanded: None,
            model_loss: gradient.as_ref().map(Gradient::loss),
        };
        if let Some(gradient) = gradient {
            let seen = Seen {
                sample,
                obs: &obs,
                scaling,
            };
            augmentation.augment(self, gradient, &seen, &mut targets);
        }
        targets
    }

    /// Steps of the critics (equation 10) and, when due, of actor and targets (lines 22 to 26).
    pub fn learn(&mut self, sample: &Sample, targets: &Targets) -> Figures {
        let mut figures = self.learn_critics(sample, targets);
        self.updates += 1;
        if self.updates.is_multiple_of(self.settings.policy_delay) {
            let batch = ActorBatch {
                rows: sample.batch.rows,
                observed: &targets.observed,
                previous_action: &sample.batch.previous_action,
                noise: &sample.policy,
            };
            let actor = self.base.step(batch, &self.critics);
            figures.actor_loss = Some(actor.loss);
            figures.entropy = actor.entropy;
            let tau = self.settings.tau;
            let (base, critics) = (&mut self.base, &mut self.critics);
            join(|| base.polyak(tau), || critics.polyak(tau));
        }
        figures
    }

    /// Steps of the critics alone.
    pub fn learn_critics(&mut self, sample: &Sample, targets: &Targets) -> Figures {
        let rows = sample.batch.rows;
        let (losses, values) = self.critics.step(targets.rows(&sample.batch));
        Figures {
            critic_losses: losses,
            q_mean: values[..rows].iter().sum::<f32>() / rows as f32,
            actor_loss: None,
            entropy: None,
            model_loss: targets.model_loss,
            imagination: targets.imaginary.as_ref().map(|i| i.figures(rows)),
        }
    }

    pub(super) fn observe(&self, obs: &[f32], previous: &[f32]) -> Vec<f32> {
        self.settings
            .coupling
            .observe(obs, previous, self.obs_size, self.action_size)
    }
}

/// What the rows `range` of `batch` add to the gradient of the dynamics model's loss.
fn model_gradient(
    model: &DynamicsModel,
    batch: &Batch,
    range: Range<usize>,
    scaling: &ObservationScaling,
) -> Gradient {
    let size = scaling.size();
    let obs = scaling.scale(rows_of(&batch.obs, size, &range));
    let next_obs = scaling.scale(rows_of(&batch.next_obs, size, &range));
    let part = ModelBatch {
        obs: &obs,
        action: rows_of(&batch.action, batch.action.len() / batch.rows, &range),
        next_obs: &next_obs,
        reward: &batch.reward[range],
    };
    model.differentiate(part, batch.rows)
}
