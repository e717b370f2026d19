//! Which imaginary rows train the critics (paper, equations 8 and 9).

use super::{TargetComparison, UncertaintyScale};

/// Keeps rows whose imaginary target is not below the real one (equation 8).
#[derive(Debug, Clone, Copy)]
pub struct TargetFilter(pub TargetComparison);

impl TargetFilter {
    fn passes(self, y_hat: f32, y: f32) -> bool {
        match self.0 {
            TargetComparison::GreaterEqual => y_hat >= y,
            TargetComparison::Greater => y_hat > y,
        }
    }
}

/// Keeps rows with probability `Delta / max Delta`, `Delta` being the disagreement of the target
/// critics (equation 9).
#[derive(Debug, Clone, Copy)]
pub struct UncertaintyFilter {
    scale: UncertaintyScale,
    /// Largest disagreement since phase 2 began.
    running_max: f32,
}

impl UncertaintyFilter {
    /// Nothing seen yet.
    pub fn new(scale: UncertaintyScale) -> UncertaintyFilter {
        UncertaintyFilter {
            scale,
            running_max: 0.0,
        }
    }

    /// The same with `running_max` as the largest disagreement seen so far.
    pub fn at(self, running_max: f32) -> UncertaintyFilter {
        UncertaintyFilter {
            running_max,
            ..self
        }
    }

    /// Largest disagreement since phase 2 began.
    pub fn running_max(&self) -> f32 {
        self.running_max
    }

    /// Takes the disagreements of a whole batch into account and returns what they are divided by.
    fn observe(&mut self, disagreement: &[f32]) -> f32 {
        let batch_max = disagreement.iter().copied().fold(0.0, f32::max);
        self.running_max = self.running_max.max(batch_max);
        match self.scale {
            UncertaintyScale::RunningMax => self.running_max,
            UncertaintyScale::BatchMax => batch_max,
        }
    }
}

/// What the filters leave of a batch.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Kept {
    /// Indices of the rows that passed both filters, ascending.
    pub rows: Vec<usize>,
    /// Rows that pass the target filter.
    pub by_target: usize,
    /// Rows that pass the uncertainty filter.
    pub by_uncertainty: usize,
}

/// Applies the filters that are switched on to `n` rows: imaginary targets `y_hat`, real targets
/// `y`, disagreements `Delta` and uniform draws in [0, 1), `[n]` each.
///
/// Where the scale of the uncertainty filter is 0 nothing is kept.
pub fn keep(
    target: Option<TargetFilter>,
    uncertainty: Option<&mut UncertaintyFilter>,
    y_hat: &[f32],
    y: &[f32],
    disagreement: &[f32],
    uniform: &[f32],
) -> Kept {
    let max = uncertainty.map(|filter| filter.observe(disagreement));
    let mut kept = Kept::default();
    for row in 0..y_hat.len() {
        let by_target = target.is_none_or(|filter| filter.passes(y_hat[row], y[row]));
        let by_uncertainty =
            max.is_none_or(|max| max > 0.0 && uniform[row] < disagreement[row] / max);
        kept.by_target += usize::from(by_target);
        kept.by_uncertainty += usize::from(by_uncertainty);
        if by_target && by_uncertainty {
            kept.rows.push(row);
        }
    }
    kept
}

#[cfg(test)]
mod tests {
    use super::*;

    const Y: [f32; 4] = [1.0, 1.0, 1.0, 1.0];
    const Y_HAT: [f32; 4] = [0.5, 1.0, 2.0, 3.0];
    const DELTA: [f32; 4] = [4.0, 4.0, 1.0, 0.0];
    const U: [f32; 4] = [0.9, 0.9, 0.2, 0.0];

    fn rows(
        target: Option<TargetComparison>,
        uncertainty: Option<&mut UncertaintyFilter>,
    ) -> Vec<usize> {
        keep(
            target.map(TargetFilter),
            uncertainty,
            &Y_HAT,
            &Y,
            &DELTA,
            &U,
        )
        .rows
    }

    #[test]
    fn each_filter_alone_and_both() {
        let mut by_batch = UncertaintyFilter::new(UncertaintyScale::BatchMax);
        assert_eq!(rows(None, None), [0, 1, 2, 3]);
        assert_eq!(rows(Some(TargetComparison::GreaterEqual), None), [1, 2, 3]);
        assert_eq!(rows(Some(TargetComparison::Greater), None), [2, 3]);
        assert_eq!(rows(None, Some(&mut by_batch)), [0, 1, 2]);
        assert_eq!(
            rows(Some(TargetComparison::Greater), Some(&mut by_batch)),
            [2]
        );
    }

    #[test]
    fn the_running_maximum_remembers_and_the_batch_maximum_does_not() {
        let mut running = UncertaintyFilter::new(UncertaintyScale::RunningMax).at(16.0);
        assert!(
            rows(None, Some(&mut running)).is_empty(),
            "4 / 16 is below each draw"
        );
        assert_eq!(running.running_max(), 16.0);
        let mut batch = UncertaintyFilter::new(UncertaintyScale::BatchMax).at(16.0);
        assert_eq!(rows(None, Some(&mut batch)), [0, 1, 2]);
    }

    #[test]
    fn nothing_is_kept_where_the_critics_agree_everywhere() {
        let mut filter = UncertaintyFilter::new(UncertaintyScale::RunningMax);
        let kept = keep(None, Some(&mut filter), &Y_HAT, &Y, &[0.0; 4], &[0.0; 4]);
        assert!(kept.rows.is_empty());
    }
}
