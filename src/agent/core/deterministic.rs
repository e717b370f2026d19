//! The actor of DDPG and TD3: a deterministic policy with a target network.

use super::actor::{Actor, ActorBatch, NextOutput};
use super::critics::Critics;
use crate::agent::{AgentSettings, BaseAlgorithm, Metrics, SmoothingSettings};
use crate::core::parallel::halves;
use crate::nn::{
    Coupling, Gradient, LearningState, Mlp, TrainableNetwork, WeightError, Weights, matrix, rows_of,
};
use burn::tensor::{Device, Tensor};

/// A deterministic policy and its target, whose actions TD3 smooths and DDPG does not.
pub struct Deterministic {
    actor: TrainableNetwork,
    target: Mlp,
    coupling: Coupling,
    smoothing: Option<SmoothingSettings>,
}

impl Deterministic {
    /// A policy trained on `device`.
    pub fn new(settings: &AgentSettings, actor: Mlp, target: Mlp, device: &Device) -> Self {
        let smooths = settings.base == BaseAlgorithm::Td3;
        Self {
            actor: TrainableNetwork::new(actor, settings.networks.actor_learning_rate, device),
            target,
            coupling: settings.coupling,
            smoothing: smooths.then(|| settings.smoothing.clone()),
        }
    }
}

impl Actor for Deterministic {
    fn output(&self, observed: &[f32]) -> Vec<f32> {
        let mut output = self.actor.mlp().forward(observed);
        self.coupling.output_in_place(&mut output);
        output
    }

    fn next_output(&self, observed: &[f32], noise: &[f32]) -> NextOutput {
        let mut output = self.target.forward(observed);
        self.coupling.output_in_place(&mut output);
        if let Some(smoothing) = &self.smoothing {
            let limit = self.coupling.limit as f32;
            let deviation = smoothing.deviation as f32 * limit;
            let clip = smoothing.clip as f32 * limit;
            for (u, z) in output.iter_mut().zip(noise) {
                *u = (*u + (deviation * z).clamp(-clip, clip)).clamp(-limit, limit);
            }
        }
        NextOutput {
            output,
            entropy_bonus: None,
        }
    }

    /// On `-mean Q1(s, p, couple(pi(s), p))`. The critic's parameters get no gradients.
    fn step(&mut self, batch: ActorBatch<'_>, critics: &Critics, metrics: &mut Metrics) {
        let width = batch.observed.len() / batch.rows;
        let sa = batch.previous_action.len() / batch.rows;
        let device = self.actor.device().clone();
        let critic = critics.first().frozen();
        let coupling = self.coupling;
        let gradient = Gradient::sum(halves(batch.rows, |range| {
            self.actor.differentiate(|actor| {
                let observed = rows_of(batch.observed, width, &range).to_vec();
                let observed = matrix(observed, width, &device);
                let previous = rows_of(batch.previous_action, sa, &range).to_vec();
                let output = coupling.output(actor.forward(observed.clone()));
                let action = coupling.execute(output, matrix(previous, sa, &device));
                let q = critic.forward(Tensor::cat(vec![observed, action], 1));
                q.sum() * (-1.0 / batch.rows as f64)
            })
        }));
        metrics.set("actor_loss", gradient.loss());
        self.actor.step(gradient);
    }

    fn move_target(&mut self, tau: f64) {
        self.target.polyak(self.actor.mlp(), tau);
    }

    fn save(&self, weights: &mut Weights) {
        self.actor.mlp().save("actor", weights);
        self.target.save("target_actor", weights);
    }

    fn is_finite(&self) -> bool {
        self.actor.is_finite()
    }

    fn save_state(&self, state: &mut LearningState) {
        self.actor.save_optimizer("actor", state);
    }

    fn restore(&mut self, state: &LearningState) -> Result<(), WeightError> {
        self.actor.restore_optimizer("actor", state)
    }

    fn network(&self) -> &Mlp {
        self.actor.mlp()
    }
}
