//! An agent: a base algorithm, its critics, and what is added to their update.

use super::base::{self, ActorBatch, Base};
use super::critics::{CriticRows, Critics};
use super::{AgentSettings, ExpandedTargets, Figures, ImaginaryTargets, Policy, Sample};
use crate::imagination::{DynamicsModel, Imagination, ModelBatch, World};
use crate::nn::{Gradient, Memory, Mlp, ObservationScaling, WeightError, Weights, rows_of};
use crate::parallel::{halves, join};
use crate::random::Stream;
use crate::replay::Batch;
use burn::tensor::Device;
use std::ops::Range;

/// What is added to the critics' update.
pub enum Augmentation {
    /// Nothing: the base algorithm.
    None,
    /// Imaginary transitions by other actions (paper, section 4).
    Imagination(Imagination),
    /// Targets over imagined steps (Feinberg et al. 2018).
    Expansion {
        /// Where actions lead.
        world: World,
        /// Imagined steps after the real one, at least 1.
        horizon: usize,
    },
}

impl Augmentation {
    /// The world that is imagined, if any.
    pub fn world(&self) -> Option<&World> {
        match self {
            Augmentation::None => None,
            Augmentation::Imagination(imagination) => Some(&imagination.world),
            Augmentation::Expansion { world, .. } => Some(world),
        }
    }

    fn remember(&self, memory: &mut Memory) {
        if let Some(world) = self.world() {
            world.model.save_optimizer(memory);
        }
        if let Augmentation::Imagination(imagination) = self {
            imagination.remember(memory);
        }
    }

    fn restore(&mut self, memory: &Memory) -> Result<(), WeightError> {
        if let Some(world) = self.world_mut() {
            world.model.restore_optimizer(memory)?;
        }
        match self {
            Augmentation::Imagination(imagination) => imagination.restore(memory),
            _ => Ok(()),
        }
    }

    fn world_mut(&mut self) -> Option<&mut World> {
        match self {
            Augmentation::None => None,
            Augmentation::Imagination(imagination) => Some(&mut imagination.world),
            Augmentation::Expansion { world, .. } => Some(world),
        }
    }
}

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
        let expands = matches!(augmentation, Augmentation::Expansion { .. });

        // The real targets don't need the model: each thread takes half of both.
        let modelling = augmentation.world().zip(sample.model.as_ref());
        let [first, second] = halves(batch.rows, |range| {
            let gradient = modelling.map(|(world, draws)| {
                model_gradient(&world.model, &draws.batch, range.clone(), scaling)
            });
            let y = if expands {
                Vec::new()
            } else {
                self.real_targets(sample, range, scaling)
            };
            (gradient, y)
        });
        let mut targets = Targets {
            observed,
            y: [first.1, second.1].concat(),
            imaginary: None,
            expanded: None,
            model_loss: None,
        };
        let gradients = first.0.zip(second.0);
        let gradient = gradients.map(|(first, second)| Gradient::sum([first, second]));
        targets.model_loss = gradient.as_ref().map(Gradient::loss);
        match (augmentation, gradient) {
            (Augmentation::Imagination(imagination), Some(gradient)) => {
                let observed = &targets.observed;
                let ((), policy) = join(
                    || imagination.world.model.step(gradient),
                    || self.base.output(observed),
                );
                let y = &targets.y;
                let imaginary =
                    self.imaginary_targets(imagination, sample, &obs, &policy, y, scaling);
                targets.imaginary = Some(imaginary);
            }
            (Augmentation::Expansion { world, horizon }, Some(gradient)) => {
                world.model.step(gradient);
                let observed = &targets.observed;
                let expanded = self.expanded_targets(world, *horizon, sample, observed, scaling);
                targets.y.clone_from(&expanded.positions[0].y);
                targets.expanded = Some(expanded);
            }
            _ => (),
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
        let (losses, values) = self.critics.step(self.critic_rows(&sample.batch, targets));
        Figures {
            critic_losses: losses,
            q_mean: values[..rows].iter().sum::<f32>() / rows as f32,
            actor_loss: None,
            entropy: None,
            model_loss: targets.model_loss,
            imagination: targets.imaginary.as_ref().map(|i| i.figures(rows)),
        }
    }

    /// The real rows first, then what augments them, in one batch.
    fn critic_rows(&self, batch: &Batch, targets: &Targets) -> CriticRows {
        if let Some(expanded) = &targets.expanded {
            return expanded.rows();
        }
        let width = targets.observed.len() / batch.rows;
        let mut rows = CriticRows::default();
        let weight = 1.0 / batch.rows as f32;
        rows.extend(&targets.observed, width, &batch.action, &targets.y, weight);
        if let Some(imaginary) = &targets.imaginary {
            imaginary.extend(&mut rows, &targets.observed, batch);
        }
        rows
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
