//! Which transitions are learned from.

use crate::core::random::Stream;
use crate::nn::{LearningState, WeightError};
use rand::RngExt;

/// A choice of transitions.
#[derive(Debug, Clone, PartialEq)]
pub struct Chosen {
    /// Where they lie in the buffer.
    pub indices: Vec<usize>,
    /// Weights of their losses; empty where all are 1.
    pub weights: Vec<f32>,
}

/// Chooses transitions from a replay buffer, and is told what became of them.
pub trait Sampler: Send + Sync {
    /// `rows` of the `stored` transitions, at least one of which there is.
    fn choose(&self, stored: usize, rows: usize, rng: &mut Stream) -> Chosen;

    /// A transition was stored at `index`.
    fn stored(&mut self, index: usize) {
        let _ = index;
    }

    /// Saves what it goes on from.
    fn save_state(&self, state: &mut LearningState) {
        let _ = state;
    }

    /// Goes on from what was saved.
    ///
    /// # Errors
    /// When something of it is missing or has another shape.
    fn restore(&mut self, state: &LearningState) -> Result<(), WeightError> {
        let _ = state;
        Ok(())
    }

    /// The critics' absolute errors on the transitions at `indices`, before they learned from them.
    fn learned(&mut self, indices: &[usize], errors: &[f32]) {
        let _ = (indices, errors);
    }
}

/// Every transition is as likely as any other, with replacement.
#[derive(Debug, Clone, Copy, Default)]
pub struct Uniform;

impl Sampler for Uniform {
    fn choose(&self, stored: usize, rows: usize, rng: &mut Stream) -> Chosen {
        Chosen {
            indices: (0..rows).map(|_| rng.random_range(0..stored)).collect(),
            weights: Vec::new(),
        }
    }
}
