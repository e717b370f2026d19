//! The deterministic actor and the coupling of its actions.

use super::{Mlp, WeightError, Weights, side_by_side};
use crate::random::Stream;
use burn::module::Module;
use burn::tensor::{Device, Tensor};

/// How a policy's output becomes the executed action (the published runs' action coupling):
/// `a = clip(beta u + (1 - beta) p, +-limit)` with `p` the previous executed action.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Coupling {
    /// `beta`, in (0, 1]; 1 means that `p` is no input of any network.
    pub beta: f64,
    /// Every action number lies within plus and minus this.
    pub limit: f64,
}

impl Coupling {
    /// Whether the previous action matters, and is an input of actor and critics.
    pub fn uses_previous(self) -> bool {
        self.beta < 1.0
    }

    /// What actor and critics see beside the action, row by row: `s`, or `s` and `p` side by side.
    pub fn observe(
        self,
        obs: &[f32],
        previous: &[f32],
        obs_size: usize,
        action_size: usize,
    ) -> Vec<f32> {
        if self.uses_previous() {
            side_by_side(&[(obs, obs_size), (previous, action_size)])
        } else {
            obs.to_vec()
        }
    }

    /// Width of [`observe`](Coupling::observe)'s result.
    pub fn observed_width(self, obs_size: usize, action_size: usize) -> usize {
        obs_size + if self.uses_previous() { action_size } else { 0 }
    }

    /// The executed action for the output `u`, `[n, action_size]` each.
    pub fn execute(self, output: Tensor<2>, previous: Tensor<2>) -> Tensor<2> {
        if self.uses_previous() {
            (output * self.beta + previous * (1.0 - self.beta)).clamp(-self.limit, self.limit)
        } else {
            output.clamp(-self.limit, self.limit)
        }
    }

    /// [`execute`](Coupling::execute) on any number of actions, in place.
    pub fn execute_in_place(self, output: &mut [f32], previous: &[f32]) {
        let (beta, limit) = (self.beta as f32, self.limit as f32);
        for (u, p) in output.iter_mut().zip(previous) {
            *u = (beta * *u + (1.0 - beta) * p).clamp(-limit, limit);
        }
    }
}

/// `pi(s, p)`: perceptron, then tanh times the action limit.
#[derive(Module, Debug)]
pub struct Actor {
    mlp: Mlp,
    #[module(skip)]
    limit: f64,
}

impl Actor {
    /// A fresh actor from `inputs` numbers to `actions` numbers within `limit`.
    pub fn new(
        inputs: usize,
        hidden: &[usize],
        actions: usize,
        limit: f64,
        rng: &mut Stream,
        device: &Device,
    ) -> Actor {
        Actor {
            mlp: Mlp::new(&widths(inputs, hidden, actions), rng, device),
            limit,
        }
    }

    /// The policy's output `u` for `[n, inputs]` (see [`Coupling::observe`]), before coupling.
    pub fn forward(&self, observed: Tensor<2>) -> Tensor<2> {
        self.mlp.forward(observed).tanh() * self.limit
    }

    /// See [`Mlp::polyak`].
    pub fn polyak(&mut self, online: &Actor, tau: f64) {
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
        actions: usize,
        limit: f64,
        weights: &Weights,
        device: &Device,
    ) -> Result<Actor, WeightError> {
        Ok(Actor {
            mlp: Mlp::load(name, &widths(inputs, hidden, actions), weights, device)?,
            limit,
        })
    }
}

fn widths(inputs: usize, hidden: &[usize], actions: usize) -> Vec<usize> {
    [&[inputs], hidden, &[actions]].concat()
}
