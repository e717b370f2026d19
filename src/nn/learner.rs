//! A network with its optimiser.

use super::adam::Adam;
use super::{Mlp, TrainableMlp};
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

    /// The gradient of `loss`, a scalar.
    pub fn differentiate(&self, loss: impl FnOnce(&TrainableMlp) -> Tensor<1>) -> Gradient {
        Gradient(vec![differentiate(self.trainable(), loss)])
    }

    /// The gradient of a loss that is a sum over `rows` rows, taken in two halves side by side.
    pub fn differentiate_by_rows(
        &self,
        rows: usize,
        loss: impl Fn(&TrainableMlp, Range<usize>) -> Tensor<1> + Sync,
    ) -> Gradient {
        let parts = halves(rows, |range| {
            // Leaves of its own: gradients through shared ones would wait for each other.
            let module = self.trainable().valid().train();
            differentiate(&module, |module| loss(module, range))
        });
        Gradient(parts.into())
    }

    /// One Adam step down `gradient`.
    pub fn step(&mut self, gradient: Gradient) {
        let parts = gradient.0.into_iter().map(|(_, part)| part).collect();
        let (adam, mlp) = (&mut self.adam, &mut self.mlp);
        self.trainable = self
            .trainable
            .take()
            .map(|module| adam.step(module, parts, mlp));
    }

    fn trainable(&self) -> &TrainableMlp {
        self.trainable.as_ref().expect("no step is in progress")
    }
}

/// A loss and its gradient, as a sum of one or two parts.
pub struct Gradient(Vec<(f32, GradientsParams)>);

impl Gradient {
    /// The loss.
    pub fn loss(&self) -> f32 {
        self.0.iter().map(|(loss, _)| loss).sum()
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
