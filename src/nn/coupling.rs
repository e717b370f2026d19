//! From a policy's network to the executed action.

use super::side_by_side;
use burn::tensor::Tensor;

/// How the actor's network becomes the executed action (the published runs' action coupling):
/// `u = limit tanh(network)`, `a = clip(beta u + (1 - beta) p, +-limit)` with `p` the previous
/// executed action. Each step is here twice: on tensors, to be differentiated, and on slices.
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

    /// The policy's output `u` of what the network gives, `[n, action_size]`.
    pub fn output(self, network: Tensor<2>) -> Tensor<2> {
        network.tanh() * self.limit
    }

    /// [`output`](Coupling::output) in place.
    pub fn output_in_place(self, network: &mut [f32]) {
        let limit = self.limit as f32;
        network.iter_mut().for_each(|x| *x = limit * x.tanh());
    }

    /// The executed action for the output `u`, `[n, action_size]` each.
    pub fn execute(self, output: Tensor<2>, previous: Tensor<2>) -> Tensor<2> {
        let coupled = if self.uses_previous() {
            output * self.beta + previous * (1.0 - self.beta)
        } else {
            output
        };
        coupled.clamp(-self.limit, self.limit)
    }

    /// [`execute`](Coupling::execute) in place.
    pub fn execute_in_place(self, output: &mut [f32], previous: &[f32]) {
        let (beta, limit) = (self.beta as f32, self.limit as f32);
        for (u, p) in output.iter_mut().zip(previous) {
            *u = (beta * *u + (1.0 - beta) * p).clamp(-limit, limit);
        }
    }
}
