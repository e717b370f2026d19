//! What one update consumes: transitions and noise, all drawn beforehand.

use crate::random::{Stream, fill_normal};
use crate::replay::Batch;
use rand::RngExt;

/// Transitions and noise of one update.
#[derive(Debug, Clone)]
pub struct Sample {
    /// The batch the critics and the actor learn from.
    pub batch: Batch,
    /// Standard normal draws of the next action at `s'`, `[n, action_size]`: of the target policy's
    /// smoothing, or of the policy itself if that is stochastic.
    pub smoothing: Vec<f32>,
    /// Standard normal draws of the actor's step, `[n, action_size]`, of stochastic policies.
    pub policy: Vec<f32>,
    /// For agents that have a model.
    pub model: Option<ModelDraws>,
}

/// What agents with a model consume besides.
#[derive(Debug, Clone)]
pub struct ModelDraws {
    /// The batch of the model's step, of as many rows as the other one.
    pub batch: Batch,
    /// For agents that imagine.
    pub imagination: Option<ImaginationDraws>,
}

/// What imagination consumes.
#[derive(Debug, Clone)]
pub struct ImaginationDraws {
    /// Standard normal draws of the imaginary actions' noise, `[n, action_size]`.
    pub action: Vec<f32>,
    /// Standard normal draws of the next action at `s_hat`, `[n, action_size]`.
    pub smoothing: Vec<f32>,
    /// Uniform draws in [0, 1) of the uncertainty filter, `[n]`.
    pub keep: Vec<f32>,
}

impl ImaginationDraws {
    /// Draws the noise for `rows` rows.
    pub fn draw(rows: usize, action_size: usize, rng: &mut Stream) -> ImaginationDraws {
        ImaginationDraws {
            action: standard_normal(rows * action_size, rng),
            smoothing: standard_normal(rows * action_size, rng),
            keep: (0..rows).map(|_| rng.random::<f32>()).collect(),
        }
    }
}

impl Sample {
    /// Draws the noise of the next actions for `batch`; nothing for the actor or a model.
    pub fn draw(batch: Batch, action_size: usize, rng: &mut Stream) -> Sample {
        Sample {
            smoothing: standard_normal(batch.rows * action_size, rng),
            batch,
            policy: Vec::new(),
            model: None,
        }
    }

    /// Draws the noise of the actor's step too.
    pub fn with_policy_noise(mut self, action_size: usize, rng: &mut Stream) -> Sample {
        self.policy = standard_normal(self.batch.rows * action_size, rng);
        self
    }
}

fn standard_normal(n: usize, rng: &mut Stream) -> Vec<f32> {
    let mut draws = vec![0.0; n];
    fill_normal(rng, &mut draws);
    draws
}
