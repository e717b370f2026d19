//! Coloured noise.

use crate::core::random::Stream;
use rand_distr::{Distribution, StandardNormal};
use std::f64::consts::TAU;

/// Gaussian noise along a horizon whose power falls with the frequency to some power (Timmer and Koenig 1995), each
/// number of variance 1. Exponent 0 is white noise.
pub(super) struct Coloured {
    /// What each of the normal draws adds to each step, `[draws, horizon]`.
    basis: Vec<Vec<f32>>,
}

impl Coloured {
    /// Noise over `horizon` steps; `exponent` is that of the power.
    pub fn new(horizon: usize, exponent: f64) -> Coloured {
        let n = horizon as f64;
        let mut basis = Vec::new();
        for k in 0..=horizon / 2 {
            // The constant part has the power of the slowest wave, as a spectrum that rises without end has none.
            let frequency = k.max(1) as f64 / n;
            let amplitude = frequency.powf(-exponent / 2.0);
            let wave = |phase: f64| -> Vec<f32> {
                let step = |t: usize| {
                    let angle = TAU * k as f64 * t as f64 / n;
                    (amplitude * (angle + phase).cos()) as f32
                };
                (0..horizon).map(step).collect()
            };
            // Waves but for the constant and the fastest one have a phase, and hence two draws.
            basis.push(wave(0.0));
            if k > 0 && 2 * k < horizon {
                basis.push(wave(TAU / 4.0));
            }
        }
        // The variance is the same at every step but for the constant's and the fastest wave's share, which have
        // the same power at all steps as well.
        let power: f32 = basis.iter().map(|wave| wave[0] * wave[0]).sum();
        let scale = 1.0 / power.sqrt();
        for x in basis.iter_mut().flatten() {
            *x *= scale;
        }
        Coloured { basis }
    }

    /// Adds `deviation` times the noise to the numbers of one actuator, which lie `stride` apart.
    pub fn add(
        &self,
        out: &mut [f32],
        stride: usize,
        deviation: impl Fn(usize) -> f32,
        rng: &mut Stream,
    ) {
        for wave in &self.basis {
            let z: f32 = StandardNormal.sample(rng);
            for (t, (x, w)) in out.iter_mut().step_by(stride).zip(wave).enumerate() {
                *x += deviation(t) * z * w;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::core::random::stream;

    /// Mean products of the numbers `lag` steps apart, over many series.
    fn covariance(horizon: usize, exponent: f64, lag: usize) -> Vec<f64> {
        let (coloured, mut rng) = (Coloured::new(horizon, exponent), stream(1, "noise"));
        let draws = 20_000;
        let mut sums = vec![0.0; horizon - lag];
        for _ in 0..draws {
            let mut series = vec![0.0; horizon];
            coloured.add(&mut series, 1, |_| 1.0, &mut rng);
            for (t, sum) in sums.iter_mut().enumerate() {
                *sum += f64::from(series[t] * series[t + lag]) / f64::from(draws);
            }
        }
        sums
    }

    #[test]
    fn every_step_has_the_variance_one() {
        for (horizon, exponent) in [(20, 0.0), (20, 2.0), (15, 3.5), (1, 2.0), (2, 1.0)] {
            for variance in covariance(horizon, exponent, 0) {
                assert!(
                    (variance - 1.0).abs() < 0.05,
                    "{horizon} {exponent}: {variance}"
                );
            }
        }
    }

    #[test]
    fn the_higher_the_exponent_the_more_alike_are_neighbours() {
        let mean = |exponent| covariance(20, exponent, 1).iter().sum::<f64>() / 19.0;
        let (white, pink, red) = (mean(0.0), mean(1.0), mean(3.0));
        assert!(white.abs() < 0.15, "{white}");
        assert!(
            white + 0.2 < pink && pink + 0.1 < red && red > 0.8,
            "{white} {pink} {red}"
        );
    }
}
