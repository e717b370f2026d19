//! Bootstrap intervals and probabilities of improvement.
//!
//! Both follow Agarwal et al. 2021, "Deep reinforcement learning at the edge of the statistical precipice":
//! percentile intervals of a stratified bootstrap, which resamples runs within each task, and the probability that a run
//! of one side is better than one of the other. Here runs are paired, and a pair is resampled as a whole.

use crate::core::random::{Stream, stream};
use rand::RngExt;
use serde::Serialize;

/// An interval of 95 % confidence.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Interval {
    /// Its lower end.
    pub low: f64,
    /// Its upper end.
    pub high: f64,
}

/// A figure with its interval, where there are two pairs or more to resample.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Estimate {
    /// The figure.
    pub value: f64,
    /// The interval around it.
    pub interval: Option<Interval>,
}

/// One figure of both runs of a pair.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Both {
    pub a: f64,
    pub b: f64,
}

/// Mean difference `a - b` of one task's pairs.
pub(super) fn difference(pairs: &[Both]) -> f64 {
    pairs.iter().map(|pair| pair.a - pair.b).sum::<f64>() / pairs.len() as f64
}

/// Probability that a run of side A has more than one of side B, equals counting half, over all pairs of runs (the
/// Mann-Whitney statistic).
pub(super) fn improvement(pairs: &[Both]) -> f64 {
    let mut wins = 0.0;
    for a in pairs.iter().map(|pair| pair.a) {
        for b in pairs.iter().map(|pair| pair.b) {
            wins += f64::from(u8::from(a > b)) + 0.5 * f64::from(u8::from(a == b));
        }
    }
    wins / (pairs.len() * pairs.len()) as f64
}

/// Mean of `statistic` over the tasks, with the interval of `repetitions` resamplings of each task's pairs. The same
/// pairs give the same interval.
pub(super) fn bootstrap(
    tasks: &[Vec<Both>],
    statistic: impl Fn(&[Both]) -> f64,
    repetitions: usize,
) -> Estimate {
    let mean = |tasks: &[Vec<Both>]| {
        tasks.iter().map(|pairs| statistic(pairs)).sum::<f64>() / tasks.len() as f64
    };
    let value = mean(tasks);
    if tasks.iter().any(|pairs| pairs.len() < 2) {
        return Estimate {
            value,
            interval: None,
        };
    }
    let mut rng = stream(0, "bootstrap");
    let mut resampled = tasks.to_vec();
    let mut means: Vec<f64> = (0..repetitions)
        .map(|_| {
            for (drawn, pairs) in resampled.iter_mut().zip(tasks) {
                draw(drawn, pairs, &mut rng);
            }
            mean(&resampled)
        })
        .collect();
    means.sort_by(f64::total_cmp);
    let interval = Interval {
        low: quantile(&means, 0.025),
        high: quantile(&means, 0.975),
    };
    Estimate {
        value,
        interval: Some(interval),
    }
}

/// Fills `drawn` with pairs, each as often as chance has it.
fn draw(drawn: &mut [Both], pairs: &[Both], rng: &mut Stream) {
    for place in drawn {
        *place = pairs[rng.random_range(0..pairs.len())];
    }
}

/// Of sorted values, by straight lines between them (NumPy's default).
fn quantile(sorted: &[f64], q: f64) -> f64 {
    let at = q * (sorted.len() - 1) as f64;
    let (below, above) = (at.floor() as usize, at.ceil() as usize);
    sorted[below] + (at - below as f64) * (sorted[above] - sorted[below])
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand_distr::{Distribution, Normal};

    fn both(pairs: &[(f64, f64)]) -> Vec<Both> {
        pairs.iter().map(|&(a, b)| Both { a, b }).collect()
    }

    #[test]
    fn difference_and_improvement_of_known_pairs() {
        let pairs = both(&[(3.0, 1.0), (2.0, 2.0), (0.0, 4.0)]);
        assert_eq!(difference(&pairs), (2.0 + 0.0 - 4.0) / 3.0);
        // 3 beats 1 and 2; 2 beats 1 and equals 2; 0 beats none: 3.5 of 9.
        assert!((improvement(&pairs) - 3.5 / 9.0).abs() < 1e-12);
    }

    #[test]
    fn quantiles_are_interpolated() {
        let sorted = [0.0, 1.0, 2.0, 10.0];
        assert_eq!(quantile(&sorted, 0.5), 1.5);
        assert_eq!(quantile(&sorted, 1.0), 10.0);
        assert_eq!(quantile(&sorted, 0.0), 0.0);
        assert_eq!(quantile(&[7.0], 0.3), 7.0);
    }

    #[test]
    fn a_single_pair_has_no_interval() {
        let one = [both(&[(1.0, 0.0)])];
        let estimate = bootstrap(&one, difference, 100);
        assert_eq!((estimate.value, estimate.interval), (1.0, None));
    }

    #[test]
    fn equal_differences_have_an_interval_of_no_width() {
        let tasks = [both(&[(1.0, 0.0), (5.0, 4.0)]), both(&[(3.0, 0.0); 3])];
        let estimate = bootstrap(&tasks, difference, 200);
        assert_eq!(estimate.value, 2.0);
        assert_eq!(
            estimate.interval,
            Some(Interval {
                low: 2.0,
                high: 2.0
            })
        );
    }

    /// The interval of a mean of 40 normal differences is close to that of the normal distribution, and in about
    /// 95 of 100 experiments it holds the true mean.
    #[test]
    fn intervals_hold_the_truth_about_as_often_as_they_say() {
        let normal = Normal::new(1.5, 2.0).unwrap();
        let mut rng = stream(3, "statistics test");
        let mut held = 0;
        for _ in 0..200 {
            let pairs: Vec<Both> = (0..40)
                .map(|_| Both {
                    a: normal.sample(&mut rng),
                    b: 0.0,
                })
                .collect();
            let estimate = bootstrap(&[pairs], difference, 400);
            let Interval { low, high } = estimate.interval.unwrap();
            assert!((0.6..2.0).contains(&(high - low)), "{low} to {high}");
            held += usize::from((low..=high).contains(&1.5));
        }
        assert!((176..=199).contains(&held), "{held} of 200");
    }

    #[test]
    fn the_same_pairs_give_the_same_interval() {
        let tasks = [both(&[(1.0, 0.0), (5.0, 2.0), (3.0, 3.0)])];
        assert_eq!(
            bootstrap(&tasks, improvement, 500),
            bootstrap(&tasks, improvement, 500)
        );
    }
}
