//! A network with its optimiser.

use super::{Adam, Mlp, TrainableMlp};
use crate::parallel::halves;
use burn::module::Module;
use burn::optim::GradientsParams;
use burn::tensor::{Device, Tensor};
use std::ops::Range;

/// A network under training: the differentiable one, its Adam moments, and a copy to predict with
/// that follows every step.
pub struct Learner {
    /// Only a step in progress leaves it empty: a network that is owned is changed in place.
    trainable: Option<TrainableMlp>,
    mlp: Mlp,
    adam: Adam,
    /// With automatic differentiation.
    device: Device,
}

impl Learner {
    /// `mlp` to be trained on `device`, with fresh moments.
    pub fn new(mlp: Mlp, learning_rate: f64, device: &Device) -> Learner {
        let device = device.clone().autodiff();
        Learner {
            trainable: Some(TrainableMlp::of(&mlp, &device)),
            mlp,
            adam: Adam::new(learning_rate),
            device,
        }
    }

    /// The network as it is now, to predict with.
    pub fn mlp(&self) -> &Mlp {
        &self.mlp
    }

    /// The network as it is now, to differentiate through; its own parameters get no gradients.
    pub fn frozen(&self) -> TrainableMlp {
        self.trainable().clone().no_grad()
    }

    /// The device to put the inputs of a loss on.
    pub fn device(&self) -> &Device {
        &self.device
    }

    /// See [`Mlp::set_output_bias`]; to be used before training, for it forgets the moments.
    pub fn set_output_bias(&mut self, value: f32) {
        self.mlp.set_output_bias(value);
        self.trainable = Some(TrainableMlp::of(&self.mlp, &self.device));
        self.adam = self.adam.forgetful();
    }

    /// One Adam step down the gradient of `loss`, a scalar. Returns the loss.
    pub fn step(&mut self, loss: impl FnOnce(&TrainableMlp) -> Tensor<1>) -> f32 {
        let (loss, gradients) = differentiate(self.trainable(), loss);
        self.apply(vec![gradients]);
        loss
    }

    /// One Adam step down the gradient of a loss that is a sum over `rows` rows, taken in two
    /// halves side by side. Returns the loss.
    pub fn step_by_rows(
        &mut self,
        rows: usize,
        loss: impl Fn(&TrainableMlp, Range<usize>) -> Tensor<1> + Sync,
    ) -> f32 {
        let [(first, gradients), (second, more)] = halves(rows, |range| {
            // Leaves of its own: gradients through shared ones would wait for each other.
            let module = self.trainable().valid().train();
            differentiate(&module, |module| loss(module, range))
        });
        self.apply(vec![gradients, more]);
        first + second
    }

    fn trainable(&self) -> &TrainableMlp {
        self.trainable.as_ref().expect("no step is in progress")
    }

    fn apply(&mut self, gradients: Vec<GradientsParams>) {
        let (adam, mlp) = (&mut self.adam, &mut self.mlp);
        self.trainable = self
            .trainable
            .take()
            .map(|module| adam.step(module, gradients, mlp));
    }
}

/// The loss and its gradients by the parameters of `module`.
fn differentiate(
    module: &TrainableMlp,
    loss: impl FnOnce(&TrainableMlp) -> Tensor<1>,
) -> (f32, GradientsParams) {
    let loss = loss(module);
    let gradients = GradientsParams::from_grads(loss.backward(), module);
    (loss.without_autodiff().into_scalar::<f32>(), gradients)
}
