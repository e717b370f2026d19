//! A network with its optimiser.

use super::halves;
use burn::module::{Module, ModuleVisitor, Param};
use burn::optim::{AdamConfig, GradientsParams, ModuleOptimizer};
use burn::tensor::Tensor;
use std::ops::Range;

/// Adam's published epsilon; burn's own default is larger.
const ADAM_EPSILON: f32 = 1e-8;

/// A network under training and its Adam moments.
pub struct Learner<M: Module> {
    module: M,
    optimizer: ModuleOptimizer,
    learning_rate: f64,
}

impl<M: Module + Sync> Learner<M> {
    /// `module`, which must live on a device with automatic differentiation, with fresh moments.
    pub fn new(module: M, learning_rate: f64) -> Learner<M> {
        Learner {
            module,
            optimizer: AdamConfig::new().with_epsilon(ADAM_EPSILON).init(),
            learning_rate,
        }
    }

    /// The network under training.
    pub fn module(&self) -> &M {
        &self.module
    }

    /// Replaces the network by a change of it, keeping the moments.
    pub fn map(&mut self, change: impl FnOnce(M) -> M) {
        self.module = change(self.module.clone());
    }

    /// One Adam step down the gradient of `loss`, a scalar. Returns the loss.
    pub fn step(&mut self, loss: impl FnOnce(&M) -> Tensor<1>) -> f32 {
        let (loss, gradients) = differentiate(&self.module, loss);
        self.apply(gradients);
        loss
    }

    /// One Adam step down the gradient of a loss that is a sum over `rows` rows, taken in two
    /// halves side by side. Returns the loss.
    pub fn step_by_rows(
        &mut self,
        rows: usize,
        loss: impl Fn(&M, Range<usize>) -> Tensor<1> + Sync,
    ) -> f32
    where
        M: Send,
    {
        let [(first, mut gradients), (second, more)] = halves(rows, |range| {
            // Leaves of its own: gradients through shared ones would wait for each other.
            let module = self.module.valid().train();
            differentiate(&module, |module| loss(module, range))
        });
        self.module.visit(&mut Sum { gradients: &mut gradients, more });
        self.apply(gradients);
        first + second
    }

    fn apply(&mut self, gradients: GradientsParams) {
        self.module = self.optimizer.step(self.learning_rate, self.module.clone(), gradients);
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

/// Adds the gradients of a second half to those of the first, parameter by parameter.
struct Sum<'a> {
    gradients: &'a mut GradientsParams,
    more: GradientsParams,
}

impl ModuleVisitor for Sum<'_> {
    fn visit_float<const D: usize>(&mut self, param: &Param<Tensor<D>>) {
        if let (Some(a), Some(b)) = (
            self.gradients.remove::<D>(param.id),
            self.more.remove::<D>(param.id),
        ) {
            self.gradients.register(param.id, a + b);
        }
    }
}
