//! Figures of a few runs, each with an interval of 95 % confidence. Every interval of the program is made here.
//!
//! * Means have intervals of Student's t: [`mean`]. Bootstrap intervals of three or five values hold the true mean far less
//!   often than they say (76 and 84 times of 100 for normal ones); those of t hold it 95 times for normal values whatever their
//!   number, more often for heavy tails, and about 89 times for values as skewed as an exponential distribution.
//! * The interquartile mean of the runs of one task is a trimmed mean and has the interval of Tukey and McLaughlin (1963), also
//!   of t: [`interquartile_mean`].
//! * Everything else (the probability of improvement, and what is taken of all runs of several tasks at once) has
//!   percentile intervals of a stratified bootstrap, after Agarwal et al. 2021, "Deep reinforcement learning at the edge
//!   of the statistical precipice": [`bootstrap`]. They are too narrow for fewer than five runs a task.
//!
//! A stratum is what one task gives: its runs or its pairs of runs. Where a stratum has a single one nothing is known of its
//! spread, and there is no interval.

use crate::core::random::stream;
use rand::RngExt;
use serde::Serialize;
use statrs::distribution::{ContinuousCDF, StudentsT};

/// Part of a distribution that lies below the upper end of an interval of 95 %.
const UPPER: f64 = 0.975;

/// An interval of 95 % confidence.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Interval {
    /// Its lower end.
    pub low: f64,
    /// Its upper end.
    pub high: f64,
}

/// A figure with its interval, where each stratum has two values or more.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Estimate {
    /// The figure.
    pub value: f64,
    /// The interval around it.
    pub interval: Option<Interval>,
}

impl Estimate {
    /// `value` with the interval of Student's t: `variance` is that of the value, from so many `degrees` of freedom.
    fn of_t(value: f64, variance: f64, degrees: f64) -> Estimate {
        // Without spread there are no degrees of freedom to count.
        let reach = if variance == 0.0 {
            Some(0.0)
        } else {
            let t = StudentsT::new(0.0, 1.0, degrees).ok();
            t.map(|t| t.inverse_cdf(UPPER) * variance.sqrt())
        };
        Estimate {
            value,
            interval: reach.map(|reach| Interval {
                low: value - reach,
                high: value + reach,
            }),
        }
    }
}

/// Mean over the strata of the mean of each, none of which is empty. Its variance is put together from those of the strata, with
/// the degrees of freedom of Welch and Satterthwaite; for one stratum of n values these are n - 1.
pub(super) fn mean(strata: &[Vec<f64>]) -> Estimate {
    let count = strata.len() as f64;
    let value = strata.iter().map(|stratum| average(stratum)).sum::<f64>() / count;
    if strata.iter().any(|stratum| stratum.len() < 2) {
        return Estimate {
            value,
            interval: None,
        };
    }
    let (mut variance, mut squares) = (0.0, 0.0);
    for stratum in strata {
        let n = stratum.len() as f64;
        let part = squared_deviations(stratum) / (n - 1.0) / n;
        variance += part;
        squares += part * part / (n - 1.0);
    }
    Estimate::of_t(
        value,
        variance / (count * count),
        variance * variance / squares,
    )
}

/// Interquartile mean of some values, at least one: of n, sorted, n / 4 (rounded down) are left out at each end. Of fewer than
/// four it is their mean. The variance is that of the values after those left out took the place of their neighbours.
pub(super) fn interquartile_mean(values: &[f64]) -> Estimate {
    let (value, cut) = (iqm(values), values.len() / 4);
    let kept = (values.len() - 2 * cut) as f64;
    if values.len() < 2 {
        return Estimate {
            value,
            interval: None,
        };
    }
    let mut winsorised = sorted(values);
    let last = winsorised.len() - 1 - cut;
    let (low, high) = (winsorised[cut], winsorised[last]);
    winsorised[..cut].fill(low);
    winsorised[last..].fill(high);
    let variance = squared_deviations(&winsorised) / (kept * (kept - 1.0));
    Estimate::of_t(value, variance, kept - 1.0)
}

/// `statistic` of the strata, with the percentile interval of `repetitions` resamplings, each of which draws as many values from
/// each stratum as it has. The same values give the same interval.
pub(super) fn bootstrap<T: Copy>(
    strata: &[Vec<T>],
    statistic: impl Fn(&[Vec<T>]) -> f64,
    repetitions: usize,
) -> Estimate {
    let value = statistic(strata);
    if strata.iter().any(|stratum| stratum.len() < 2) {
        return Estimate {
            value,
            interval: None,
        };
    }
    let mut rng = stream(0, "bootstrap");
    let mut resampled = strata.to_vec();
    let mut values: Vec<f64> = (0..repetitions)
        .map(|_| {
            for (drawn, stratum) in resampled.iter_mut().zip(strata) {
                drawn.fill_with(|| stratum[rng.random_range(0..stratum.len())]);
            }
            statistic(&resampled)
        })
        .collect();
    values.sort_by(f64::total_cmp);
    Estimate {
        value,
        interval: Some(Interval {
            low: quantile(&values, 1.0 - UPPER),
            high: quantile(&values, UPPER),
        }),
    }
}

/// Probability that one of `a` is more than one of `b`, equals counting half, over all pairs of both (the Mann-Whitney
/// statistic).
pub(super) fn improvement(a: &[f64], b: &[f64]) -> f64 {
    let mut wins = 0.0;
    for a in a {
        for b in b {
            wins += f64::from(u8::from(a > b)) + 0.5 * f64::from(u8::from(a == b));
        }
    }
    wins / (a.len() * b.len()) as f64
}

/// Interquartile mean of some values, at least one.
pub(super) fn iqm(values: &[f64]) -> f64 {
    let (sorted, cut) = (sorted(values), values.len() / 4);
    average(&sorted[cut..sorted.len() - cut])
}

/// The value in the middle of some, at least one; the mean of both where there are two.
pub(super) fn median(values: &[f64]) -> f64 {
    quantile(&sorted(values), 0.5)
}

/// Mean of some values, at least one.
pub(super) fn average(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len() as f64
}

fn squared_deviations(values: &[f64]) -> f64 {
    let mean = average(values);
    values.iter().map(|value| (value - mean).powi(2)).sum()
}

fn sorted(values: &[f64]) -> Vec<f64> {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    sorted
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
    use crate::core::random::Stream;
    use rand_distr::{Distribution, Exp1, StandardNormal, StudentT};

    /// Ends of an interval to three digits behind the point.
    fn ends(estimate: Estimate) -> [f64; 2] {
        let Interval { low, high } = estimate.interval.unwrap();
        [low, high].map(|end| (1000.0 * end).round() / 1000.0)
    }

    #[test]
    fn intervals_of_means_are_those_of_the_tables() {
        // 3 +- 12.706 x 1; 2.5 +- 3.182 x 0.6455.
        assert_eq!(ends(mean(&[vec![2.0, 4.0]])), [-9.706, 15.706]);
        assert_eq!(ends(mean(&[vec![1.0, 2.0, 3.0, 4.0]])), [0.446, 4.554]);
        // Two strata of equal variance and n have 2 (n - 1) degrees of freedom: 2 +- 4.303 x 1 / sqrt(2).
        let two = mean(&[vec![0.0, 2.0], vec![2.0, 4.0]]);
        assert_eq!((two.value, ends(two)), (2.0, [-1.042, 5.042]));
    }

    #[test]
    fn intervals_of_interquartile_means_are_those_of_trimmed_means() {
        let few = [5.0, 1.0, 3.0];
        assert_eq!(interquartile_mean(&few), mean(&[few.to_vec()]));
        // 1 of 5 is left out at each end: the mean of 2, 3, 4. Winsorised 2, 2, 3, 4, 4 have 4 squared
        // deviations; 3 +- 4.303 x sqrt(4 / (3 x 2)).
        let five = interquartile_mean(&[100.0, 3.0, 2.0, -50.0, 4.0]);
        assert_eq!((five.value, ends(five)), (3.0, [-0.513, 6.513]));
    }

    #[test]
    fn a_single_value_has_no_interval() {
        for estimate in [
            mean(&[vec![1.0]]),
            interquartile_mean(&[1.0]),
            bootstrap(&[vec![1.0]], |strata| strata[0][0], 100),
        ] {
            assert_eq!((estimate.value, estimate.interval), (1.0, None));
        }
        assert_eq!(mean(&[vec![1.0, 2.0], vec![1.0]]).interval, None);
    }

    #[test]
    fn equal_values_have_an_interval_of_no_width() {
        let tasks = [vec![1.0, 1.0], vec![3.0; 3]];
        let narrow = Some(Interval {
            low: 2.0,
            high: 2.0,
        });
        assert_eq!(mean(&tasks).interval, narrow);
        let mean_of_means = |tasks: &[Vec<f64>]| (average(&tasks[0]) + average(&tasks[1])) / 2.0;
        assert_eq!(bootstrap(&tasks, mean_of_means, 200).interval, narrow);
    }

    /// Of how many intervals out of 1000 hold `truth`, `draw` giving the values of one experiment.
    fn held(
        truth: f64,
        estimate: impl Fn(&[f64]) -> Estimate,
        n: usize,
        draw: impl Fn(&mut Stream) -> f64,
    ) -> f64 {
        let mut rng = stream(3, "statistics test");
        let mut held = 0;
        for _ in 0..4000 {
            let values: Vec<f64> = (0..n).map(|_| draw(&mut rng)).collect();
            let Interval { low, high } = estimate(&values).interval.unwrap();
            held += usize::from((low..=high).contains(&truth));
        }
        held as f64 / 4.0
    }

    #[test]
    fn intervals_hold_the_truth_about_as_often_as_they_say() {
        let normal = |rng: &mut Stream| StandardNormal.sample(rng);
        let skewed = |rng: &mut Stream| Exp1.sample(rng);
        let tails = StudentT::new(3.0).unwrap();
        let heavy = |rng: &mut Stream| tails.sample(rng);
        let of_one = |values: &[f64]| mean(&[values.to_vec()]);
        for n in [3, 5, 10] {
            let found = held(0.0, of_one, n, normal);
            assert!((935.0..965.0).contains(&found), "normal, {n}: {found}");
            let found = held(1.0, of_one, n, skewed);
            assert!((860.0..960.0).contains(&found), "skewed, {n}: {found}");
            let found = held(0.0, of_one, n, heavy);
            assert!((940.0..985.0).contains(&found), "heavy, {n}: {found}");
            let found = held(0.0, interquartile_mean, n, normal);
            assert!((920.0..970.0).contains(&found), "IQM, {n}: {found}");
        }
        // Two tasks of three runs, one with ten times the spread.
        let of_two = |values: &[f64]| {
            let wide = values[3..].iter().map(|x| 10.0 * x).collect();
            mean(&[values[..3].to_vec(), wide])
        };
        let found = held(0.0, of_two, 6, normal);
        assert!((935.0..975.0).contains(&found), "two tasks: {found}");
    }

    #[test]
    fn a_bootstrap_of_many_is_close_to_t_and_the_same_again() {
        let mut rng = stream(5, "statistics test");
        let values = [(0..60).map(|_| StandardNormal.sample(&mut rng)).collect()];
        let both = [mean(&values), bootstrap(&values, |v| average(&v[0]), 4000)];
        let [t, percentile] = both.map(|estimate| estimate.interval.unwrap());
        let width = t.high - t.low;
        for (one, other) in [(t.low, percentile.low), (t.high, percentile.high)] {
            assert!((one - other).abs() < 0.1 * width, "{t:?} {percentile:?}");
        }
        assert_eq!(bootstrap(&values, |v| average(&v[0]), 4000), both[1]);
    }

    #[test]
    fn improvement_and_middle_of_known_values() {
        // 3 beats 1 and 2; 2 beats 1 and equals 2; 0 beats none: 3.5 of 9.
        assert_eq!(improvement(&[3.0, 2.0, 0.0], &[1.0, 2.0, 4.0]), 3.5 / 9.0);
        assert_eq!([median(&[3.0, 1.0, 9.0]), median(&[4.0, 1.0])], [3.0, 2.5]);
    }

    #[test]
    fn quantiles_are_interpolated() {
        let sorted = [0.0, 1.0, 2.0, 10.0];
        assert_eq!(quantile(&sorted, 0.5), 1.5);
        assert_eq!(quantile(&sorted, 1.0), 10.0);
        assert_eq!(quantile(&sorted, 0.0), 0.0);
        assert_eq!(quantile(&[7.0], 0.3), 7.0);
    }
}
