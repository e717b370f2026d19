//! What an update tells of itself.

use super::EntropyFigures;

/// Figures of one update.
#[derive(Debug, Clone, PartialEq)]
pub struct Figures {
    /// Loss of each critic before its step (equation 10).
    pub critic_losses: Vec<f32>,
    /// Mean of `Q1` on the real rows.
    pub q_mean: f32,
    /// In updates that step the actor: its loss, `-mean Q1` of deterministic policies.
    pub actor_loss: Option<f32>,
    /// In updates that step a stochastic actor.
    pub entropy: Option<EntropyFigures>,
    /// Loss of the model's step (equation 5), of agents that have a model.
    pub model_loss: Option<f32>,
    /// Of agents that imagine.
    pub imagination: Option<ImaginationFigures>,
}

/// Figures of the imaginary part of one update.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ImaginationFigures {
    /// Bound `eta` of the actions' noise.
    pub noise_bound: f64,
    /// Fraction of the rows that passes the target filter.
    pub by_target: f64,
    /// Fraction of the rows that passes the uncertainty filter.
    pub by_uncertainty: f64,
    /// Fraction of the rows that passes both.
    pub kept: f64,
}

impl Figures {
    /// Name of the first figure that is not finite.
    pub fn not_finite(&self) -> Option<&'static str> {
        let named = [
            ("model loss", self.model_loss),
            ("loss of critic 1", self.critic_losses.first().copied()),
            ("loss of critic 2", self.critic_losses.get(1).copied()),
            ("actor loss", self.actor_loss),
            ("temperature loss", self.entropy.map(|e| e.temperature_loss)),
        ];
        let wrong = named
            .into_iter()
            .find(|(_, value)| value.is_some_and(|x| !x.is_finite()));
        wrong.map(|(name, _)| name)
    }
}
