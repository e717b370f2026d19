//! What stands between the layers of a perceptron, as data: each on slices, to predict, and on tensors, to be
//! differentiated.

use burn::tensor::Tensor;
use burn::tensor::activation::relu;
use serde::{Deserialize, Serialize};

/// What a hidden layer's numbers pass through, one by one.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Activation {
    /// `max(x, 0)`.
    Relu,
    /// `x` above 0, `exp(x) - 1` below (Clevert et al. 2016).
    Elu,
}

/// What is done to a hidden layer's numbers before the activation, row by row; none has parameters.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Normalisation {
    /// Nothing.
    None,
    /// `(x - mean) / sqrt(variance + 1e-5)` over the row (Ba et al. 2016).
    Layer,
    /// `x / mean |x|` over the row (Fujimoto et al. 2023, section 4).
    #[serde(rename = "average_l1")]
    AverageL1,
}

/// Added to a variance before its root.
const VARIANCE_FLOOR: f64 = 1e-5;
/// Smallest mean absolute value divided by.
const L1_FLOOR: f64 = 1e-8;

impl Activation {
    /// In place.
    pub fn apply(self, numbers: &mut [f32]) {
        match self {
            // Unlike `max` this lets a NaN through, so that it is noticed; and unlike a branch it is done for many
            // numbers at once.
            Activation::Relu => numbers
                .iter_mut()
                .for_each(|x| *x = if *x < 0.0 { 0.0 } else { *x }),
            Activation::Elu => numbers
                .iter_mut()
                .for_each(|x| *x = if *x < 0.0 { x.exp_m1() } else { *x }),
        }
    }

    /// Of a tensor.
    pub fn of(self, x: Tensor<2>) -> Tensor<2> {
        match self {
            Activation::Relu => relu(x),
            // The negative part alone goes through the exponential, which would overflow above.
            Activation::Elu => relu(x.clone()) + (x.clamp_max(0.0).exp() - 1.0),
        }
    }
}

impl Normalisation {
    /// In place, of rows of this `width`.
    pub fn apply(self, numbers: &mut [f32], width: usize) {
        let mean = |row: &[f32], of: fn(f32) -> f32| {
            row.iter().map(|x| f64::from(of(*x))).sum::<f64>() / width as f64
        };
        match self {
            Normalisation::None => (),
            Normalisation::Layer => {
                for row in numbers.chunks_exact_mut(width) {
                    let centre = mean(row, |x| x) as f32;
                    row.iter_mut().for_each(|x| *x -= centre);
                    let deviation = (mean(row, |x| x * x) + VARIANCE_FLOOR).sqrt() as f32;
                    row.iter_mut().for_each(|x| *x /= deviation);
                }
            }
            Normalisation::AverageL1 => {
                for row in numbers.chunks_exact_mut(width) {
                    let size = mean(row, f32::abs).max(L1_FLOOR) as f32;
                    row.iter_mut().for_each(|x| *x /= size);
                }
            }
        }
    }

    /// Of a tensor, `[n, width]`.
    pub fn of(self, x: Tensor<2>) -> Tensor<2> {
        match self {
            Normalisation::None => x,
            Normalisation::Layer => {
                let centred = x.clone() - x.mean_dim(1);
                let variance = (centred.clone() * centred.clone()).mean_dim(1);
                centred / (variance + VARIANCE_FLOOR).sqrt()
            }
            Normalisation::AverageL1 => {
                let size = x.clone().abs().mean_dim(1).clamp_min(L1_FLOOR);
                x / size
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::core::random::stream;
    use crate::nn::{Architecture, Backend, Mlp, TrainableMlp, matrix, to_vec};

    #[test]
    fn slices_and_tensors_agree_for_every_architecture() {
        let device = Backend::Flex.device();
        let rows: Vec<f32> = (0..60).map(|i| 3.0 * (i as f32).sin()).collect();
        for activation in [Activation::Relu, Activation::Elu] {
            for normalisation in [
                Normalisation::None,
                Normalisation::Layer,
                Normalisation::AverageL1,
            ] {
                let architecture = Architecture {
                    widths: vec![3, 16, 16, 2],
                    activation,
                    normalisation,
                };
                let mlp = Mlp::new(&architecture, &mut stream(1, "activation"));
                let predicted = mlp.forward(&rows);
                let trained = TrainableMlp::of(&mlp, &device);
                let trained = to_vec(trained.forward(matrix(rows.clone(), 3, &device)));
                for (a, b) in predicted.iter().zip(&trained) {
                    let what = format!("{activation:?}, {normalisation:?}");
                    assert!((a - b).abs() < 1e-5 * (1.0 + b.abs()), "{what}: {a} {b}");
                }
            }
        }
    }

    #[test]
    fn normalised_rows_are_what_their_names_say() {
        let row = [1.0f32, -2.0, 3.0, 6.0];
        let mut layer = row;
        Normalisation::Layer.apply(&mut layer, 4);
        let mean = layer.iter().sum::<f32>() / 4.0;
        let variance = layer.iter().map(|x| x * x).sum::<f32>() / 4.0;
        assert!(mean.abs() < 1e-6 && (variance - 1.0).abs() < 1e-4);
        let mut average = row;
        Normalisation::AverageL1.apply(&mut average, 4);
        assert_eq!(average, row.map(|x| x / 3.0));
        let mut elu = [-1.0f32, 2.0, 200.0];
        Activation::Elu.apply(&mut elu);
        assert_eq!(elu, [(-1.0f32).exp_m1(), 2.0, 200.0]);
    }
}
