//! Multilayer perceptrons as burn modules, for training.

use super::{Activation, Mlp, Normalisation};
use burn::module::{Module, Param};
use burn::nn::Linear;
use burn::tensor::{Device, Tensor, TensorData};

/// The burn counterpart of an [`Mlp`]: differentiable, on a device.
#[derive(Module, Debug)]
pub struct TrainableMlp {
    layers: Vec<Linear>,
    #[module(skip)]
    normalisation: Normalisation,
    #[module(skip)]
    activation: Activation,
}

impl TrainableMlp {
    /// A copy of `mlp` on `device`, which must have automatic differentiation to train it.
    pub fn of(mlp: &Mlp, device: &Device) -> TrainableMlp {
        let linear = |layer: &super::mlp::Dense| {
            let weight = TensorData::new(layer.weight.clone(), [layer.inputs, layer.outputs]);
            let bias = TensorData::new(layer.bias.clone(), [layer.outputs]);
            Linear {
                weight: Param::from_data(weight, device),
                bias: Some(Param::from_data(bias, device)),
            }
        };
        let (normalisation, activation) = mlp.between();
        TrainableMlp {
            normalisation,
            activation,
            layers: mlp.layers().iter().map(linear).collect(),
        }
    }

    /// `[n, inputs]` to `[n, outputs]`.
    pub fn forward(&self, input: Tensor<2>) -> Tensor<2> {
        let (last, hidden) = self.layers.split_last().expect("at least one layer");
        let features = hidden.iter().fold(input, |x, layer| {
            self.activation.of(self.normalisation.of(layer.forward(x)))
        });
        last.forward(features)
    }
}
