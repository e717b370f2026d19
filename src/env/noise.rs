//! Random numbers of resets.

use rand::RngExt;
use rand_distr::{Distribution, StandardNormal};

use crate::core::random::Stream;

/// Adds independent uniform numbers of `[-scale, scale)` to `numbers`.
pub fn add_uniform(rng: &mut Stream, scale: f64, numbers: &mut [f64]) {
    for x in numbers {
        *x += uniform(rng, -scale, scale);
    }
}

/// Adds independent normal numbers of the given standard deviation to `numbers`.
pub fn add_normal(rng: &mut Stream, deviation: f64, numbers: &mut [f64]) {
    for x in numbers {
        let normal: f64 = StandardNormal.sample(rng);
        *x += deviation * normal;
    }
}

/// A uniform number of `[low, high)`.
pub fn uniform(rng: &mut Stream, low: f64, high: f64) -> f64 {
    rng.random_range(low..high)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::core::random::stream;

    #[test]
    fn noise_has_the_stated_size() {
        let mut rng = stream(0, "noise");
        let mut numbers = [1.0; 20_000];
        add_uniform(&mut rng, 0.1, &mut numbers);
        assert!(numbers.iter().all(|x| (x - 1.0).abs() <= 0.1));
        let mean = numbers.iter().sum::<f64>() / 20_000.0;
        assert!((mean - 1.0).abs() < 2e-3, "{mean}");

        let mut numbers = [0.0; 20_000];
        add_normal(&mut rng, 0.1, &mut numbers);
        let variance = numbers.iter().map(|x| x * x).sum::<f64>() / 20_000.0;
        assert!((variance.sqrt() - 0.1).abs() < 2e-3, "{variance}");
    }
}
