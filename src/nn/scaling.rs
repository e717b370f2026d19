//! Observation scaling by running mean and deviation.

use super::{WeightError, Weights};
use burn::tensor::TensorData;
use serde::{Deserialize, Serialize};

/// Mean and deviation of all observations seen, by Welford's method in double precision.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct RunningMoments {
    count: u64,
    mean: Vec<f64>,
    /// Sums of squared deviations from the mean.
    squares: Vec<f64>,
}

impl RunningMoments {
    /// Nothing seen yet, `size` coordinates.
    pub fn new(size: usize) -> RunningMoments {
        RunningMoments {
            count: 0,
            mean: vec![0.0; size],
            squares: vec![0.0; size],
        }
    }

    /// As if `count` observations had been seen that `scaling` is of.
    pub fn of(scaling: &ObservationScaling, count: u64) -> RunningMoments {
        let wide = |numbers: &[f32]| numbers.iter().map(|x| f64::from(*x)).collect::<Vec<f64>>();
        let deviation = wide(&scaling.deviation);
        RunningMoments {
            count,
            mean: wide(&scaling.mean),
            squares: deviation.iter().map(|d| d * d * count as f64).collect(),
        }
    }

    /// Length of an observation.
    pub fn size(&self) -> usize {
        self.mean.len().min(self.squares.len())
    }

    /// Takes one observation into account.
    pub fn add(&mut self, observation: &[f64]) {
        self.count += 1;
        let n = self.count as f64;
        for ((x, mean), square) in observation
            .iter()
            .zip(&mut self.mean)
            .zip(&mut self.squares)
        {
            let before = x - *mean;
            *mean += before / n;
            *square += before * (x - *mean);
        }
    }

    /// The scaling by what was seen so far; none before the first observation.
    pub fn scaling(&self, clip: f64, deviation_floor: f64) -> ObservationScaling {
        let size = self.mean.len();
        if self.count == 0 {
            return ObservationScaling::identity(size);
        }
        let n = self.count as f64;
        ObservationScaling {
            mean: self.mean.iter().map(|m| *m as f32).collect(),
            deviation: self
                .squares
                .iter()
                .map(|s| (s / n).sqrt().max(deviation_floor) as f32)
                .collect(),
            clip: clip as f32,
        }
    }
}

/// `clip((s - mean) / deviation, +-clip)`, applied when observations are used, not when stored.
#[derive(Debug, Clone, PartialEq)]
pub struct ObservationScaling {
    mean: Vec<f32>,
    deviation: Vec<f32>,
    clip: f32,
}

impl ObservationScaling {
    /// Leaves observations of `size` numbers as they are.
    pub fn identity(size: usize) -> ObservationScaling {
        ObservationScaling {
            mean: vec![0.0; size],
            deviation: vec![1.0; size],
            clip: f32::INFINITY,
        }
    }

    /// Given figures, one of each a coordinate.
    pub fn new(mean: Vec<f32>, deviation: Vec<f32>, clip: f32) -> ObservationScaling {
        ObservationScaling {
            mean,
            deviation,
            clip,
        }
    }

    /// Length of an observation.
    pub fn size(&self) -> usize {
        self.mean.len()
    }

    /// Scales whole rows.
    pub fn scale(&self, observations: &[f32]) -> Vec<f32> {
        let mut scaled = Vec::with_capacity(observations.len());
        for row in observations.chunks_exact(self.mean.len()) {
            let figures = self.mean.iter().zip(&self.deviation);
            scaled.extend(
                row.iter()
                    .zip(figures)
                    .map(|(x, (m, d))| ((x - m) / d).clamp(-self.clip, self.clip)),
            );
        }
        scaled
    }

    /// Undoes [`scale`](ObservationScaling::scale) on whole rows, in place; what was clipped stays so.
    pub fn unscale(&self, observations: &mut [f32]) {
        for row in observations.chunks_exact_mut(self.mean.len()) {
            for ((x, m), d) in row.iter_mut().zip(&self.mean).zip(&self.deviation) {
                *x = *x * d + m;
            }
        }
    }

    /// Whether all means and deviations are finite.
    pub fn is_finite(&self) -> bool {
        let mut numbers = self.mean.iter().chain(&self.deviation);
        numbers.all(|x| x.is_finite())
    }

    /// Adds `scaling.mean`, `scaling.deviation` and `scaling.clip` to `weights`.
    pub fn save(&self, weights: &mut Weights) {
        let mut insert = |name: &str, data: &[f32]| {
            weights.insert(
                format!("scaling.{name}"),
                TensorData::new(data.to_vec(), [data.len()]),
            );
        };
        insert("mean", &self.mean);
        insert("deviation", &self.deviation);
        insert("clip", &[self.clip]);
    }

    /// The saved scaling of observations of `size` numbers.
    ///
    /// # Errors
    /// When an array is missing, has another shape, or holds a bound or deviation that is not above 0.
    pub fn load(size: usize, weights: &Weights) -> Result<ObservationScaling, WeightError> {
        let read = |name: &str, size: usize| weights.get(&format!("scaling.{name}"), &[size]);
        let scaling = ObservationScaling {
            mean: read("mean", size)?,
            deviation: read("deviation", size)?,
            clip: read("clip", 1)?[0],
        };
        let positive = |x: &f32| *x > 0.0;
        if !positive(&scaling.clip) {
            return Err(WeightError::NotPositive("scaling.clip"));
        }
        if !scaling.deviation.iter().all(positive) {
            return Err(WeightError::NotPositive("scaling.deviation"));
        }
        Ok(scaling)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn running_moments_agree_with_two_passes() {
        let rows: Vec<[f64; 2]> = (0..100)
            .map(|i| [f64::from(i).sin() * 3.0 + 1e3, 7.0])
            .collect();
        let mut moments = RunningMoments::new(2);
        rows.iter().for_each(|r| moments.add(r));
        let mean = rows.iter().map(|r| r[0]).sum::<f64>() / 100.0;
        let deviation = (rows.iter().map(|r| (r[0] - mean).powi(2)).sum::<f64>() / 100.0).sqrt();
        let scaling = moments.scaling(5.0, 1e-2);
        // Those of the scaling go on as they would have, but for single precision.
        let mut of = RunningMoments::of(&scaling, 100);
        for moments in [&mut moments, &mut of] {
            moments.add(&[1e3, 9.0]);
        }
        let [after, gone_on] = [&moments, &of].map(|m| m.scaling(5.0, 1e-2));
        assert!((after.mean[0] - gone_on.mean[0]).abs() < 1e-3);
        assert!((after.deviation[0] - gone_on.deviation[0]).abs() < 1e-4);
        assert!((f64::from(scaling.mean[0]) - mean).abs() < 1e-4);
        assert!((f64::from(scaling.deviation[0]) - deviation).abs() < 1e-6);
        assert_eq!(
            scaling.deviation[1], 1e-2,
            "a constant coordinate gets the floor"
        );
    }

    #[test]
    fn scaling_clips_and_unscaling_undoes_it() {
        let scaling = ObservationScaling::new(vec![1.0, -1.0], vec![2.0, 0.5], 5.0);
        let mut scaled = scaling.scale(&[2.0, -1.5, 100.0, -100.0]);
        assert_eq!(scaled, [0.5, -1.0, 5.0, -5.0]);
        scaling.unscale(&mut scaled);
        assert_eq!(scaled, [2.0, -1.5, 11.0, -3.5]);
    }

    #[test]
    fn a_bound_or_deviation_that_is_not_above_zero_is_refused() {
        let load = |deviation: f32, clip: f32| {
            let mut weights = Weights::default();
            ObservationScaling::new(vec![0.0], vec![deviation], clip).save(&mut weights);
            ObservationScaling::load(1, &weights)
        };
        assert!(load(1.0, 5.0).is_ok() && load(1.0, f32::INFINITY).is_ok());
        for clip in [-5.0, 0.0, f32::NAN] {
            assert!(load(1.0, clip).is_err());
        }
        assert!(load(0.0, 5.0).is_err() && load(-1.0, 5.0).is_err());
    }
}
