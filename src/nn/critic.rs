//! One action-value network.

use super::{Mlp, WeightError, Weights};
use crate::random::Stream;
use burn::module::Module;
use burn::tensor::{Device, Tensor};

/// `Q(s, p, a)`.
#[derive(Module, Debug)]
pub struct Critic {
    mlp: Mlp,
}

impl Critic {
    /// A fresh critic on `inputs` numbers, action included.
    pub fn new(inputs: usize, hidden: &[usize], rng: &mut Stream, device: &Device) -> Critic {
        Critic {
            mlp: Mlp::new(&[&[inputs], hidden, &[1]].concat(), rng, device),
        }
    }

    /// Values `[n, 1]` of `[n, inputs]`: what is observed (see
    /// [`Coupling::observe`](super::Coupling::observe)) and the executed action, side by side.
    pub fn forward(&self, input: Tensor<2>) -> Tensor<2> {
        self.mlp.forward(input)
    }

    /// The bias of the output set to `value` (paper, equation 6).
    pub fn with_output_bias(self, value: f32) -> Critic {
        Critic {
            mlp: self.mlp.with_output_bias(value),
        }
    }

    /// See [`Mlp::polyak`].
    pub fn polyak(&mut self, online: &Critic, tau: f64) {
        self.mlp.polyak(&online.mlp, tau);
    }

    /// See [`Mlp::save`].
    pub fn save(&self, name: &str, weights: &mut Weights) {
        self.mlp.save(name, weights);
    }

    /// See [`Mlp::load`].
    ///
    /// # Errors
    /// When an array is missing or has another shape.
    pub fn load(
        name: &str,
        inputs: usize,
        hidden: &[usize],
        weights: &Weights,
        device: &Device,
    ) -> Result<Critic, WeightError> {
        Ok(Critic {
            mlp: Mlp::load(name, &[&[inputs], hidden, &[1]].concat(), weights, device)?,
        })
    }
}
