//! Errors of many steps, of which quantiles are wanted.

/// Errors of a series of steps, one number a step.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Series {
    /// Never NaN.
    errors: Vec<f64>,
}

impl Series {
    /// Appends the error of a step; an error that is not a number counts as infinite.
    pub fn push(&mut self, error: f64) {
        let error = if error.is_nan() { f64::INFINITY } else { error };
        self.errors.push(error);
    }

    /// Joins two series.
    pub fn merge(&mut self, other: &Series) {
        self.errors.extend_from_slice(&other.errors);
    }

    /// Number of steps.
    pub fn count(&self) -> usize {
        self.errors.len()
    }

    /// The largest error; `None` if there is none at all.
    pub fn largest(&self) -> Option<f64> {
        self.errors.iter().copied().reduce(f64::max)
    }

    /// The error that the fraction `quantile` of the steps does not exceed, interpolated linearly
    /// between neighbours; `None` if there is none at all.
    pub fn quantile(&self, quantile: f64) -> Option<f64> {
        let mut sorted = self.errors.clone();
        sorted.sort_by(f64::total_cmp);
        let place = quantile.clamp(0.0, 1.0) * sorted.len().checked_sub(1)? as f64;
        let (low, high) = (
            sorted[place.floor() as usize],
            sorted[place.ceil() as usize],
        );
        // Infinite neighbours have no difference.
        match low == high {
            true => Some(low),
            false => Some(low + place.fract() * (high - low)),
        }
    }

    /// The error that half of the steps do not exceed.
    pub fn median(&self) -> Option<f64> {
        self.quantile(0.5)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quantiles_lie_between_neighbours() {
        let mut series = Series::default();
        assert_eq!((series.median(), series.largest()), (None, None));
        for error in [3.0, 0.0, 1.0, 2.0] {
            series.push(error);
        }
        assert_eq!(series.median(), Some(1.5));
        assert_eq!(series.quantile(0.0), Some(0.0));
        assert_eq!(series.quantile(1.0), Some(3.0));
        assert_eq!(series.quantile(0.25), Some(0.75));
        assert_eq!((series.largest(), series.count()), (Some(3.0), 4));
    }

    #[test]
    fn what_is_no_number_is_infinitely_wrong() {
        let mut series = Series::default();
        series.push(f64::NAN);
        series.push(f64::INFINITY);
        assert_eq!(series.median(), Some(f64::INFINITY));
    }
}
