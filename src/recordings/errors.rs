//! How far numbers lie from recorded ones.

/// Largest and mean error of a series of comparisons.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Errors {
    largest: f64,
    sum: f64,
    count: usize,
}

impl Errors {
    /// Compares a number with the recorded one; `relative` errors are divided by the recorded size
    /// where that exceeds 1.
    pub fn add(&mut self, found: f64, recorded: f64, relative: bool) {
        let scale = if relative {
            recorded.abs().max(1.0)
        } else {
            1.0
        };
        let error = (found - recorded).abs() / scale;
        // Equal infinities and numbers that are missing on both sides count as agreement.
        let same = found == recorded || (found.is_nan() && recorded.is_nan());
        let error = match (same, error.is_nan()) {
            (true, _) => 0.0,
            (false, true) => f64::INFINITY,
            (false, false) => error,
        };
        self.largest = self.largest.max(error);
        self.sum += error;
        self.count += 1;
    }

    /// Compares number by number.
    pub fn add_all(&mut self, found: &[f64], recorded: &[f64], relative: bool) {
        for (&found, &recorded) in found.iter().zip(recorded) {
            self.add(found, recorded, relative);
        }
    }

    /// Joins two series.
    pub fn merge(&mut self, other: &Errors) {
        self.largest = self.largest.max(other.largest);
        self.sum += other.sum;
        self.count += other.count;
    }

    /// The largest error; `None` if nothing was compared.
    pub fn largest(&self) -> Option<f64> {
        (self.count > 0).then_some(self.largest)
    }

    /// The mean error; `None` if nothing was compared.
    pub fn mean(&self) -> Option<f64> {
        (self.count > 0).then(|| self.sum / self.count as f64)
    }

    /// Whether no error exceeds `tolerance`.
    pub fn within(&self, tolerance: f64) -> bool {
        self.largest <= tolerance
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn absolute_and_relative() {
        let mut errors = Errors::default();
        assert_eq!(errors.largest(), None);
        errors.add(2.0, 1.0, false);
        errors.add(1.0, 1.0, false);
        assert_eq!((errors.largest(), errors.mean()), (Some(1.0), Some(0.5)));
        let mut relative = Errors::default();
        relative.add(1010.0, 1000.0, true);
        relative.add(0.001, 0.0, true);
        assert_eq!(relative.largest(), Some(0.01));
    }

    #[test]
    fn missing_numbers_are_infinitely_wrong() {
        let mut errors = Errors::default();
        errors.add(f64::NAN, f64::NAN, false);
        assert!(errors.within(0.0));
        errors.add(f64::NAN, 1.0, false);
        assert!(!errors.within(1e300));
    }
}
