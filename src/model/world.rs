//! The world as an agent imagines it: the learned dynamics and what the designer knows.

use super::DynamicsModel;
use crate::nn::ObservationScaling;
use crate::task::Rules;
use std::sync::Arc;

/// A model of one step of the task, on batches.
pub struct World {
    /// The learned dynamics, and the reward where it is learned.
    pub model: DynamicsModel,
    rules: Arc<dyn Rules>,
}

/// Where actions lead: next observation, reward and termination.
#[derive(Debug, Clone, PartialEq)]
pub struct Imagined {
    /// Next observation, not scaled, known coordinates filled in, `[n, obs_size]`.
    pub raw: Vec<f32>,
    /// The same scaled and clipped, as networks see it.
    pub next_obs: Vec<f32>,
    /// Reward, `[n]`.
    pub reward: Vec<f32>,
    /// Termination, `[n]`, 1 or 0.
    pub terminated: Vec<f32>,
}

impl World {
    /// A world of this model and these rules.
    pub fn new(model: DynamicsModel, rules: Arc<dyn Rules>) -> World {
        World { model, rules }
    }

    /// Indices of the coordinates of an observation that need no learning, ascending.
    pub fn known(&self) -> &[usize] {
        self.rules.known()
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
        let prediction = self.model.predict(scaled_obs, action);
        let mut raw = prediction.next_obs;
        scaling.unscale(&mut raw);
        self.rules.complete_batch(obs, action, &mut raw, rows);
        let reward = prediction.reward.unwrap_or_else(|| {
            let mut reward = vec![0.0; rows];
            self.rules.reward_batch(obs, action, &raw, &mut reward);
            reward
        });
        let mut terminated = vec![0.0; rows];
        self.rules.terminated_batch(&raw, &mut terminated);
        Imagined {
            next_obs: scaling.scale(&raw),
            raw,
            reward,
            terminated,
        }
    }
}
