//! Model predictive path integral control.

use super::PlannerSettings;
use super::noise::Coloured;
use super::strategy::{Sequences, Shape, Strategy, iterations};
use crate::core::random::Stream;

/// MPPI (Williams et al. 2017): the nominal sequence becomes the mean of samples around it, weighted by their
/// exponentiated returns, which are standardised first (Xue et al. 2024), so that the temperature has no unit.
pub(super) struct Mppi {
    settings: PlannerSettings,
    shape: Shape,
    noise: Coloured,
    nominal: Vec<f32>,
}

impl Mppi {
    pub fn new(settings: PlannerSettings, shape: Shape) -> Mppi {
        Mppi {
            noise: Coloured::new(shape.horizon, settings.colour),
            nominal: vec![0.0; shape.numbers()],
            settings,
            shape,
        }
    }
}

impl Strategy for Mppi {
    fn begin(&mut self) {
        self.nominal.fill(0.0);
    }

    fn iterations(&self, step: usize) -> usize {
        iterations(&self.settings, step)
    }

    /// The nominal sequence, and others around it.
    fn propose(&mut self, _: usize, rng: &mut Stream) -> Sequences {
        let width = self.shape.action_size;
        let deviation = self.settings.noise as f32;
        let mut sequences = self.nominal.clone();
        for _ in 1..self.settings.samples {
            let begin = sequences.len();
            sequences.extend_from_slice(&self.nominal);
            let sequence = &mut sequences[begin..];
            for actuator in 0..width {
                let out = &mut sequence[actuator..];
                self.noise.add(out, width, |_| deviation, rng);
            }
            self.shape.clip(sequence);
        }
        sequences
    }

    fn learn(&mut self, _: usize, sequences: &[f32], scores: &[f64]) {
        let weights = weights(scores, self.settings.temperature);
        // Where every sequence failed there is nothing to learn.
        if weights.is_empty() {
            return;
        }
        self.nominal.fill(0.0);
        let numbers = self.shape.numbers();
        for (sequence, weight) in sequences.chunks_exact(numbers).zip(weights) {
            for (x, y) in self.nominal.iter_mut().zip(sequence) {
                *x += weight as f32 * y;
            }
        }
    }

    fn decision(&self) -> &[f32] {
        &self.nominal
    }

    fn advance(&mut self, _: &mut Stream) {
        let last = self.nominal[self.nominal.len() - self.shape.action_size..].to_vec();
        self.shape.shift(&mut self.nominal, &last);
    }

    fn another(&self) -> Box<dyn Strategy> {
        Box::new(Mppi::new(self.settings.clone(), self.shape))
    }
}

/// Weights that add up to 1: `exp(z / temperature)` of the standardised scores; none for those that failed, and none at
/// all where all did.
fn weights(scores: &[f64], temperature: f64) -> Vec<f64> {
    let sound: Vec<f64> = scores.iter().copied().filter(|s| s.is_finite()).collect();
    let n = sound.len() as f64;
    let mean = sound.iter().sum::<f64>() / n;
    let variance = sound.iter().map(|s| (s - mean).powi(2)).sum::<f64>() / n;
    let best = sound.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    if sound.is_empty() {
        return Vec::new();
    }
    // Where all are alike, so are their weights.
    let deviation = variance.sqrt().max(1e-12 * (1.0 + mean.abs()));
    let raw = |score: &f64| ((score - best) / (deviation * temperature)).exp();
    let raw: Vec<f64> = scores.iter().map(raw).collect();
    let sum: f64 = raw.iter().sum();
    raw.iter().map(|x| x / sum).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn weights_follow_the_scores_and_leave_failures_out() {
        let equal = weights(&[2.0, 2.0, f64::NEG_INFINITY], 0.1);
        assert_eq!(equal, [0.5, 0.5, 0.0]);
        let one = weights(&[1.0, 2.0, 3.0], 1e-3);
        assert!(one[2] > 0.999, "{one:?}");
        // Scores of 0 and 1 have the deviation 1/2: twice e to the power -2.
        let two = weights(&[0.0, 1.0], 1.0);
        assert!((two[0] / two[1] - (-2.0f64).exp()).abs() < 1e-12);
        assert!(weights(&[f64::NEG_INFINITY], 1.0).is_empty());
    }
}
