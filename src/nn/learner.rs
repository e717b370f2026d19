//! A network with its optimiser.

use super::Adam;
use crate::parallel::halves;
use burn::module::Module;
use burn::optim::GradientsParams;
use burn::tensor::Tensor;
use std::ops::Range;

/// A network under training and its Adam moments.
pub struct Learner<M: Module> {
    /// Only a step in progress leaves it empty: a network that is owned is changed in place.
    module: Option<M>,
    adam: Adam,
}

impl<M: Module + Send + Sync> Learner<M> {
    /// `module`, which must live on a device with automatic differentiation, with fresh moments.
    pub fn new(module: M, learning_rate: f64) -> Learner<M> {
        Learner {
            module: Some(module),
            adam: Adam::new(learning_rate),
        }
    }

    /// The network under training.
    pub fn module(&self) -> &M {
        self.module.as_ref().expect("no step is in progress")
    }

    /// Replaces the network by a change of it, keeping the moments.
    pub fn map(&mut self, change: impl FnOnce(M) -> M) {
        self.module = self.module.take().map(change);
    }

    /// One Adam step down the gradient of `loss`, a scalar. Returns the loss.
    pub fn step(&mut self, loss: impl FnOnce(&M) -> Tensor<1>) -> f32 {
        let (loss, gradients) = differentiate(self.module(), loss);
        self.apply(vec![gradients]);
        loss
    }

    /// One Adam step down the gradient of a loss that is a sum over `rows` rows, taken in two
    /// halves side by side. Returns the loss.
    pub fn step_by_rows(
        &mut self,
        rows: usize,
        loss: impl Fn(&M, Range<usize>) -> Tensor<1> + Sync,
    ) -> f32 {
        let [(first, gradients), (second, more)] = halves(rows, |range| {
            // Leaves of its own: gradients through shared ones would wait for each other.
            let module = self.module().valid().train();
            differentiate(&module, |module| loss(module, range))
        });
        self.apply(vec![gradients, more]);
        first + second
    }

    fn apply(&mut self, gradients: Vec<GradientsParams>) {
        let adam = &mut self.adam;
        self.module = self
            .module
            .take()
            .map(|module| adam.step(module, gradients));
    }
}

/// The loss and its gradients by the parameters of `module`.
fn differentiate<M: Module>(
    module: &M,
    loss: impl FnOnce(&M) -> Tensor<1>,
) -> (f32, GradientsParams) {
    let loss = loss(module);
    let gradients = GradientsParams::from_grads(loss.backward(), module);
    (loss.without_autodiff().into_scalar::<f32>(), gradients)
}
