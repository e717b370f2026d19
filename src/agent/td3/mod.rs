//! TD3, and MAMF as TD3 that also learns from imaginary transitions.

mod steps;
mod targets;

pub use targets::{ImaginaryTargets, Targets};

use super::{Figures, Policy, Sample, Td3Settings};
use crate::imagination::{DynamicsModel, Imagination};
use crate::nn::{Gradient, Learner, Mlp, ObservationScaling, WeightError, Weights, rows_of};
use crate::parallel::halves;
use crate::random::Stream;
use crate::replay::Batch;
use burn::tensor::Device;
use std::ops::Range;

/// Twin delayed deep deterministic policy gradient (Fujimoto et al. 2018) with action coupling;
/// with an [`Imagination`] it is MAMF (paper, Algorithm 1, lines 18 to 26).
pub struct Td3 {
    settings: Td3Settings,
    obs_size: usize,
    action_size: usize,
    actor: Learner,
    critics: [Learner; 2],
    target_actor: Mlp,
    target_critics: [Mlp; 2],
    imagination: Option<Imagination>,
    updates: u64,
}

/// The networks an agent starts with.
struct Networks {
    actor: Mlp,
    critics: [Mlp; 2],
    target_actor: Mlp,
    target_critics: [Mlp; 2],
}

impl Td3 {
    /// A fresh agent trained on `device`; networks are drawn from `rng`.
    pub fn new(
        settings: Td3Settings,
        obs_size: usize,
        action_size: usize,
        imagination: Option<Imagination>,
        rng: &mut Stream,
        device: &Device,
    ) -> Td3 {
        let actor = Mlp::new(&settings.actor_widths(obs_size, action_size), rng);
        let critic_widths = settings.critic_widths(obs_size, action_size);
        let critics = [(); 2].map(|()| Mlp::new(&critic_widths, rng));
        let networks = Networks {
            target_actor: actor.clone(),
            target_critics: critics.clone(),
            actor,
            critics,
        };
        Td3::from_networks(
            settings,
            obs_size,
            action_size,
            imagination,
            networks,
            device,
        )
    }

    /// An agent with saved networks, without its optimisers' moments.
    ///
    /// # Errors
    /// When an array is missing or has another shape than the settings say.
    pub fn load(
        settings: Td3Settings,
        obs_size: usize,
        action_size: usize,
        imagination: Option<Imagination>,
        weights: &Weights,
        device: &Device,
    ) -> Result<Td3, WeightError> {
        let actor_widths = settings.actor_widths(obs_size, action_size);
        let critic_widths = settings.critic_widths(obs_size, action_size);
        let critic = |name| Mlp::load(name, &critic_widths, weights);
        let networks = Networks {
            actor: Mlp::load("actor", &actor_widths, weights)?,
            critics: [critic("critic1")?, critic("critic2")?],
            target_actor: Mlp::load("target_actor", &actor_widths, weights)?,
            target_critics: [critic("target_critic1")?, critic("target_critic2")?],
        };
        Ok(Td3::from_networks(
            settings,
            obs_size,
            action_size,
            imagination,
            networks,
            device,
        ))
    }

    fn from_networks(
        settings: Td3Settings,
        obs_size: usize,
        action_size: usize,
        imagination: Option<Imagination>,
        networks: Networks,
        device: &Device,
    ) -> Td3 {
        let (actor_rate, critic_rate) = (
            settings.networks.actor_learning_rate,
            settings.networks.critic_learning_rate,
        );
        Td3 {
            settings,
            obs_size,
            action_size,
            actor: Learner::new(networks.actor, actor_rate, device),
            critics: networks
                .critics
                .map(|critic| Learner::new(critic, critic_rate, device)),
            target_actor: networks.target_actor,
            target_critics: networks.target_critics,
            imagination,
            updates: 0,
        }
    }

    /// All networks by name: `actor`, `critic1`, `critic2`, `target_actor`, `target_critic1`,
    /// `target_critic2` and `model`.
    pub fn weights(&self) -> Weights {
        let mut weights = Weights::default();
        self.actor.mlp().save("actor", &mut weights);
        self.target_actor.save("target_actor", &mut weights);
        for (i, (critic, target)) in self.critics.iter().zip(&self.target_critics).enumerate() {
            let number = i + 1;
            critic.mlp().save(&format!("critic{number}"), &mut weights);
            target.save(&format!("target_critic{number}"), &mut weights);
        }
        if let Some(imagination) = &self.imagination {
            imagination.model.save(&mut weights);
        }
        weights
    }

    /// The current policy under `scaling`.
    pub fn policy(&self, scaling: &ObservationScaling) -> Policy {
        Policy::new(
            self.actor.mlp().clone(),
            scaling.clone(),
            self.settings.coupling,
        )
    }

    /// The imagination, for agents that have one.
    pub fn imagination(&self) -> Option<&Imagination> {
        self.imagination.as_ref()
    }

    /// Optimistic start: `bias` becomes the output bias of both critics and their targets
    /// (equation 6). To be used once, before the first update.
    pub fn set_optimism(&mut self, bias: f32) {
        self.critics
            .iter_mut()
            .for_each(|critic| critic.set_output_bias(bias));
        self.target_critics
            .iter_mut()
            .for_each(|target| target.set_output_bias(bias));
    }

    /// One step of the dynamics model alone (phase 1). Returns its loss; none without a model.
    pub fn train_model(&mut self, batch: &Batch, scaling: &ObservationScaling) -> Option<f32> {
        let model = &mut self.imagination.as_mut()?.model;
        let parts = halves(batch.rows, |range| {
            model_gradient(model, batch, range, scaling)
        });
        let gradient = Gradient::sum(parts);
        let loss = gradient.loss();
        model.step(gradient);
        Some(loss)
    }

    /// Root mean square one-step error of the dynamics model on `batch`, in scaled space.
    pub fn model_error(&self, batch: &Batch, scaling: &ObservationScaling) -> Option<f32> {
        let model = &self.imagination.as_ref()?.model;
        let (obs, next) = (scaling.scale(&batch.obs), scaling.scale(&batch.next_obs));
        Some(model.error(&obs, &batch.action, &next).sqrt())
    }

    /// One step of phase 2: model, critics, and every `policy_delay` updates actor and targets.
    pub fn update(&mut self, sample: &Sample, scaling: &ObservationScaling) -> Figures {
        let targets = self.prepare(sample, scaling);
        self.learn(&sample.batch, &targets)
    }

    fn observe(&self, obs: &[f32], previous: &[f32]) -> Vec<f32> {
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
    let action = rows_of(&batch.action, batch.action.len() / batch.rows, &range);
    model.differentiate(&obs, action, &next_obs, batch.rows)
}
