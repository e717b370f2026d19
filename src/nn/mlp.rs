//! Multilayer perceptron.

use super::{WeightError, Weights};
use crate::random::Stream;
use burn::module::{Module, Param};
use burn::nn::Linear;
use burn::tensor::activation::relu;
use burn::tensor::{Device, Tensor, TensorData};
use rand_distr::{Distribution, Uniform};

/// Linear layers with ReLU between them; the last layer is linear.
#[derive(Module, Debug)]
pub struct Mlp {
    layers: Vec<Linear>,
}

impl Mlp {
    /// A perceptron of the given `widths`, input first and output last, at least two.
    ///
    /// Weights and biases are uniform within `1 / sqrt(inputs of the layer)`, the default of the
    /// library in which the published runs were made.
    pub fn new(widths: &[usize], rng: &mut Stream, device: &Device) -> Mlp {
        let layer = |pair: &[usize]| {
            let (inputs, outputs) = (pair[0], pair[1]);
            let bound = 1.0 / (inputs as f32).sqrt();
            let uniform = Uniform::new_inclusive(-bound, bound).expect("the bound is finite");
            let mut draw =
                |n: usize| -> Vec<f32> { uniform.sample_iter(&mut *rng).take(n).collect() };
            let weight = TensorData::new(draw(inputs * outputs), [inputs, outputs]);
            let bias = TensorData::new(draw(outputs), [outputs]);
            linear(weight, bias, device)
        };
        Mlp {
            layers: widths.windows(2).map(layer).collect(),
        }
    }

    /// `[n, inputs]` to `[n, outputs]`.
    pub fn forward(&self, input: Tensor<2>) -> Tensor<2> {
        let (last, hidden) = self.layers.split_last().expect("at least one layer");
        let features = hidden.iter().fold(input, |x, layer| relu(layer.forward(x)));
        last.forward(features)
    }

    /// The bias of the last layer set to `value` (paper, equation 6). To be used before training:
    /// the new bias has no moments in an optimiser.
    pub fn with_output_bias(mut self, value: f32) -> Mlp {
        if let Some(bias) = self.layers.last_mut().and_then(|layer| layer.bias.as_mut()) {
            let old = bias.val();
            let filled = TensorData::new(vec![value; old.dims()[0]], old.dims());
            *bias = Param::from_data(filled, &old.device());
        }
        self
    }

    /// Moves every parameter towards `online`'s: `(1 - tau) self + tau online`.
    pub fn polyak(&mut self, online: &Mlp, tau: f64) {
        fn mix<const D: usize>(
            target: Param<Tensor<D>>,
            online: &Param<Tensor<D>>,
            tau: f64,
        ) -> Param<Tensor<D>> {
            let online = online.val().without_autodiff();
            target.map(|t| t * (1.0 - tau) + online * tau)
        }
        // Taken out, so that each tensor is the only one of its memory and is changed in place.
        let layers = std::mem::take(&mut self.layers)
            .into_iter()
            .zip(&online.layers);
        self.layers = layers
            .map(|(target, online)| Linear {
                weight: mix(target.weight, &online.weight, tau),
                bias: target
                    .bias
                    .zip(online.bias.as_ref())
                    .map(|(t, o)| mix(t, o, tau)),
            })
            .collect();
    }

    /// Adds `<name>.l<i>.weight` (`[inputs, outputs]`) and `<name>.l<i>.bias` to `weights`, `i` from 1.
    pub fn save(&self, name: &str, weights: &mut Weights) {
        for (i, layer) in self.layers.iter().enumerate() {
            let name = format!("{name}.l{}", i + 1);
            weights.insert(format!("{name}.weight"), layer.weight.val());
            if let Some(bias) = &layer.bias {
                weights.insert(format!("{name}.bias"), bias.val());
            }
        }
    }

    /// The perceptron of the given `widths` saved as `name`.
    ///
    /// # Errors
    /// When an array is missing or has another shape.
    pub fn load(
        name: &str,
        widths: &[usize],
        weights: &Weights,
        device: &Device,
    ) -> Result<Mlp, WeightError> {
        let layers = widths.windows(2).enumerate().map(|(i, pair)| {
            let name = format!("{name}.l{}", i + 1);
            let weight = weights.get(&format!("{name}.weight"), &[pair[0], pair[1]])?;
            let bias = weights.get(&format!("{name}.bias"), &[pair[1]])?;
            Ok(linear(weight, bias, device))
        });
        Ok(Mlp {
            layers: layers.collect::<Result<_, _>>()?,
        })
    }
}

fn linear(weight: TensorData, bias: TensorData, device: &Device) -> Linear {
    Linear {
        weight: Param::from_data(weight, device),
        bias: Some(Param::from_data(bias, device)),
    }
}
