//! Multilayer perceptrons as plain numbers, for predictions.

use super::{Activation, Normalisation, WeightError, Weights};
use crate::core::random::Stream;
use burn::tensor::TensorData;
use rand_distr::{Distribution, Uniform};

/// What a perceptron is built of, as data.
#[derive(Debug, Clone, PartialEq)]
pub struct Architecture {
    /// Widths of the layers, input first and output last, at least two.
    pub widths: Vec<usize>,
    /// What every hidden layer's numbers pass through.
    pub activation: Activation,
    /// What is done to every hidden layer's numbers before that.
    pub normalisation: Normalisation,
}

impl Architecture {
    /// Plain layers with ReLU between them (paper, appendix B).
    pub fn relu(widths: &[usize]) -> Architecture {
        Architecture {
            widths: widths.to_vec(),
            activation: Activation::Relu,
            normalisation: Normalisation::None,
        }
    }
}

/// Linear layers with a normalisation and an activation between them; the last layer is linear.
///
/// This is what predicts: target networks, the acting policy, the dynamics model in imagination.
/// What is trained is a [`TrainableMlp`](super::TrainableMlp). Predictions run on the same matrix
/// kernels as burn's `flex`, without its temporaries.
#[derive(Debug, Clone, PartialEq)]
pub struct Mlp {
    layers: Vec<Dense>,
    activation: Activation,
    normalisation: Normalisation,
}

/// One layer, `y = x W + b`.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Dense {
    pub(super) inputs: usize,
    pub(super) outputs: usize,
    /// `W`, `[inputs, outputs]`.
    pub(super) weight: Vec<f32>,
    /// `b`, `[outputs]`.
    pub(super) bias: Vec<f32>,
}

impl Mlp {
    /// A perceptron of this `architecture`.
    ///
    /// Weights and biases are uniform within `1 / sqrt(inputs of the layer)`, the default of the
    /// library in which the published runs were made.
    pub fn new(architecture: &Architecture, rng: &mut Stream) -> Mlp {
        let layer = |pair: &[usize]| {
            let (inputs, outputs) = (pair[0], pair[1]);
            let bound = 1.0 / (inputs as f32).sqrt();
            let uniform = Uniform::new_inclusive(-bound, bound).expect("the bound is finite");
            let mut draw = |n: usize| uniform.sample_iter(&mut *rng).take(n).collect();
            Dense {
                inputs,
                outputs,
                weight: draw(inputs * outputs),
                bias: draw(outputs),
            }
        };
        Mlp {
            layers: architecture.widths.windows(2).map(layer).collect(),
            activation: architecture.activation,
            normalisation: architecture.normalisation,
        }
    }

    /// `[n, inputs]` to `[n, outputs]`, row by row.
    ///
    /// # Panics
    /// When `input` is not whole rows.
    pub fn forward(&self, input: &[f32]) -> Vec<f32> {
        let (first, rest) = self.layers.split_first().expect("at least one layer");
        let mut features = first.forward(input);
        for layer in rest {
            self.normalisation.apply(&mut features, layer.inputs);
            self.activation.apply(&mut features);
            features = layer.forward(&features);
        }
        features
    }

    /// Width of what comes out.
    pub fn outputs(&self) -> usize {
        self.layers.last().map_or(0, |layer| layer.outputs)
    }

    /// Moves every parameter towards `online`'s: `(1 - tau) self + tau online`.
    pub fn polyak(&mut self, online: &Mlp, tau: f64) {
        let (keep, tau) = ((1.0 - tau) as f32, tau as f32);
        for (target, online) in self.parameters_mut().zip(online.parameters()) {
            for (t, o) in target.iter_mut().zip(online) {
                *t = keep * *t + tau * o;
            }
        }
    }

    /// Sets the bias of the last layer to `value` (paper, equation 6).
    pub fn set_output_bias(&mut self, value: f32) {
        if let Some(last) = self.layers.last_mut() {
            last.bias.fill(value);
        }
    }

    /// The biases of the last layer.
    pub fn output_bias(&self) -> &[f32] {
        self.layers.last().map_or(&[], |last| &last.bias)
    }

    /// What stands between its layers.
    pub(super) fn between(&self) -> (Normalisation, Activation) {
        (self.normalisation, self.activation)
    }

    /// The layers, input first.
    pub(super) fn layers(&self) -> &[Dense] {
        &self.layers
    }

    /// Weight and bias of each layer in turn.
    pub(super) fn parameters(&self) -> impl Iterator<Item = &Vec<f32>> {
        self.layers
            .iter()
            .flat_map(|layer| [&layer.weight, &layer.bias])
    }

    /// As [`parameters`](Mlp::parameters), to be changed.
    pub(super) fn parameters_mut(&mut self) -> impl Iterator<Item = &mut Vec<f32>> {
        self.layers
            .iter_mut()
            .flat_map(|layer| [&mut layer.weight, &mut layer.bias])
    }

    /// Name and shape of each of the [`parameters`](Mlp::parameters) of the perceptron saved as `name`.
    pub(super) fn arrays(&self, name: &str) -> Vec<(String, Vec<usize>)> {
        let layers = self.layers.iter().enumerate();
        let arrays = layers.flat_map(|(i, layer)| {
            let name = format!("{name}.l{}", i + 1);
            [
                (format!("{name}.weight"), vec![layer.inputs, layer.outputs]),
                (format!("{name}.bias"), vec![layer.outputs]),
            ]
        });
        arrays.collect()
    }

    /// Adds `<name>.l<i>.weight` (`[inputs, outputs]`) and `<name>.l<i>.bias` to `weights`, `i` from 1.
    pub fn save(&self, name: &str, weights: &mut Weights) {
        for ((name, shape), numbers) in self.arrays(name).into_iter().zip(self.parameters()) {
            weights.insert(name, TensorData::new(numbers.clone(), shape));
        }
    }

    /// The perceptron of this `architecture` saved as `name`.
    ///
    /// # Errors
    /// When an array is missing or has another shape.
    pub fn load(
        name: &str,
        architecture: &Architecture,
        weights: &Weights,
    ) -> Result<Mlp, WeightError> {
        let layers = architecture.widths.windows(2).enumerate().map(|(i, pair)| {
            let (inputs, outputs) = (pair[0], pair[1]);
            let name = format!("{name}.l{}", i + 1);
            Ok(Dense {
                inputs,
                outputs,
                weight: weights.get(&format!("{name}.weight"), &[inputs, outputs])?,
                bias: weights.get(&format!("{name}.bias"), &[outputs])?,
            })
        });
        Ok(Mlp {
            layers: layers.collect::<Result<_, _>>()?,
            activation: architecture.activation,
            normalisation: architecture.normalisation,
        })
    }
}

impl Dense {
    fn forward(&self, input: &[f32]) -> Vec<f32> {
        let rows = input.len() / self.inputs;
        let mut output = Vec::with_capacity(rows * self.outputs);
        for _ in 0..rows {
            output.extend_from_slice(&self.bias);
        }
        add_product(
            &mut output,
            input,
            &self.weight,
            [rows, self.inputs, self.outputs],
        );
        output
    }
}

/// `c += a b` of row-major matrices `[m, k]` and `[k, n]`.
fn add_product(c: &mut [f32], a: &[f32], b: &[f32], [m, k, n]: [usize; 3]) {
    assert!(
        a.len() == m * k && b.len() == k * n && c.len() == m * n,
        "sizes of a matrix product"
    );
    let row = |width: usize| width as isize;
    // SAFETY: the strides are those of row-major matrices, whose lengths were checked above; `c` is
    // borrowed mutably and so overlaps neither `a` nor `b`.
    unsafe {
        gemm::gemm(
            m,
            n,
            k,
            c.as_mut_ptr(),
            1,
            row(n),
            true,
            a.as_ptr(),
            1,
            row(k),
            b.as_ptr(),
            1,
            row(n),
            1.0,
            1.0,
            false,
            false,
            false,
            gemm::Parallelism::None,
        );
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::core::random::stream;

    #[test]
    fn a_layer_is_x_w_plus_b() {
        let layer = Dense {
            inputs: 2,
            outputs: 3,
            weight: vec![1., 2., 3., 4., 5., 6.],
            bias: vec![0.5, 0., -1.],
        };
        assert_eq!(
            layer.forward(&[1., 10., 0., 1.]),
            [41.5, 52., 62., 4.5, 5., 5.]
        );
    }

    #[test]
    fn rows_are_independent_and_hidden_layers_rectified() {
        let mlp = Mlp::new(&Architecture::relu(&[3, 16, 16, 2]), &mut stream(1, "mlp"));
        let rows: Vec<f32> = (0..30).map(|i| (i as f32).sin()).collect();
        let all = mlp.forward(&rows);
        let close = |a: &[f32], b: &[f32]| a.iter().zip(b).all(|(a, b)| (a - b).abs() < 1e-6);
        assert!(close(&mlp.forward(&rows[6..9]), &all[4..6]));
        let negated: Vec<f32> = rows.iter().map(|x| -x).collect();
        assert!(!close(
            &mlp.forward(&negated),
            &all.iter().map(|y| -y).collect::<Vec<_>>()
        ));
    }

    #[test]
    fn a_nan_is_not_swallowed() {
        let mlp = Mlp::new(&Architecture::relu(&[2, 4, 1]), &mut stream(1, "mlp"));
        assert!(mlp.forward(&[f32::NAN, 0.0])[0].is_nan());
    }

    #[test]
    fn polyak_moves_by_tau() {
        let mut target = Mlp::new(&Architecture::relu(&[1, 2]), &mut stream(1, "a"));
        let (before, online) = (
            target.clone(),
            Mlp::new(&Architecture::relu(&[1, 2]), &mut stream(1, "b")),
        );
        target.polyak(&online, 0.25);
        let moved =
            |i: usize| 0.75 * before.layers[0].weight[i] + 0.25 * online.layers[0].weight[i];
        assert_eq!(target.layers[0].weight, [moved(0), moved(1)]);
    }
}
