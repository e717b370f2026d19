//! What an update tells of itself.

/// Figures of one update.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Figures {
    /// Loss of each critic before its step (equation 10).
    pub critic_losses: [f32; 2],
    /// Mean of `Q1` on the real rows.
    pub q_mean: f32,
    /// In updates that step the actor: its loss, `-mean Q1`.
    pub actor_loss: Option<f32>,
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
        let actor = self.actor_loss.unwrap_or(0.0);
        let model = self.model_loss.unwrap_or(0.0);
        [
            ("model loss", model),
            ("loss of critic 1", self.critic_losses[0]),
            ("loss of critic 2", self.critic_losses[1]),
            ("actor loss", actor),
        ]
        .into_iter()
        .find(|(_, value)| !value.is_finite())
        .map(|(name, _)| name)
    }
}
