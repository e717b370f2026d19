//! A network with its optimiser.

use super::adam::Adam;
use super::{LearningState, Mlp, TrainableMlp, WeightError};
use burn::module::Module;
use burn::optim::GradientsParams;
use burn::tensor::{Device, Tensor};

/// A network under training: the differentiable one, its Adam moments, and a copy to predict with
/// that follows every step.
pub struct TrainableNetwork {
    /// Only a step in progress leaves it empty: a network that is owned is changed in place.
    trainable: Option<TrainableMlp>,
    mlp: Mlp,
    adam: Adam,
    /// With automatic differentiation.
    device: Device,
}

impl TrainableNetwork {
    /// `mlp` to be trained on `device`, with fresh moments.
    pub fn new(mlp: Mlp, learning_rate: f64, device: &Device) -> TrainableNetwork {
        let device = device.clone().autodiff();
        TrainableNetwork {
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

    /// Whether all parameters and second moments have been finite after every step.
    pub fn is_finite(&self) -> bool {
        self.adam.is_finite()
    }

    /// Saves what the optimiser of the network saved as `name` goes on from.
    pub fn save_optimizer(&self, name: &str, state: &mut LearningState) {
        self.adam.save(name, &self.mlp, state);
    }

    /// Has the optimiser go on from what was saved.
    ///
    /// # Errors
    /// When something of it is missing or has another shape than the network.
    pub fn restore_optimizer(
        &mut self,
        name: &str,
        state: &LearningState,
    ) -> Result<(), WeightError> {
        self.adam.restore(name, &self.mlp, state)
    }

    /// See [`Mlp::set_output_bias`]; to be used before training, for it forgets the moments.
    pub fn set_output_bias(&mut self, value: f32) {
        self.mlp.set_output_bias(value);
        self.trainable = Some(TrainableMlp::of(&self.mlp, &self.device));
        self.adam = self.adam.forgetful();
    }

    /// The gradient of `loss`, a scalar.
    pub fn differentiate(&self, loss: impl FnOnce(&TrainableMlp) -> Tensor<1>) -> Gradient {
        // Leaves of its own: gradients through shared ones, taken on two threads, would wait for
        // each other.
        let module = self.trainable().valid().train();
        let loss = loss(&module);
        let parameters = GradientsParams::from_grads(loss.backward(), &module);
        Gradient {
            loss: loss.without_autodiff().into_scalar::<f32>(),
            parts: vec![parameters],
        }
    }

    /// One Adam step down `gradient`.
    pub fn step(&mut self, gradient: Gradient) {
        let (adam, mlp) = (&mut self.adam, &mut self.mlp);
        let step = |module| adam.step(module, gradient.parts, mlp);
        self.trainable = self.trainable.take().map(step);
    }

    fn trainable(&self) -> &TrainableMlp {
        self.trainable.as_ref().expect("no step is in progress")
    }
}

/// A loss and its gradient.
pub struct Gradient {
    loss: f32,
    /// What adds up to the gradient.
    parts: Vec<GradientsParams>,
}

impl Gradient {
    /// The loss.
    pub fn loss(&self) -> f32 {
        self.loss
    }

    /// Loss and gradient of the sum of two losses of one network.
    pub fn sum([mut first, second]: [Gradient; 2]) -> Gradient {
        first.loss += second.loss;
        first.parts.extend(second.parts);
        first
    }
}
