//! What one learning curve is measured by.

/// A learning curve: environment steps and the value there, steps growing.
pub(super) type Points = [(u64, f64)];

/// What is compared.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, clap::ValueEnum, serde::Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Metric {
    /// Mean return of an evaluation
    #[default]
    Return,
    /// Fraction of an evaluation's episodes that succeeded
    Success,
}

/// Mean of the evaluations in the last tenth of `horizon` steps; of the last one before where there is none.
pub(super) fn final_value(curve: &Points, horizon: u64) -> f64 {
    let until = before(curve, horizon);
    let from = horizon - horizon / 10;
    let first = until.partition_point(|(step, _)| *step < from);
    let last_tenth = &until[first.min(until.len() - 1)..];
    last_tenth.iter().map(|(_, value)| value).sum::<f64>() / last_tenth.len() as f64
}

/// Mean height of the curve up to `horizon` steps: the area under straight lines between evaluations, over the
/// steps between the first and the last one.
pub(super) fn mean_height(curve: &Points, horizon: u64) -> f64 {
    let until = before(curve, horizon);
    let (first, last) = (until[0], until[until.len() - 1]);
    if first.0 == last.0 {
        return last.1;
    }
    let trapezoid = |pair: &Points| (pair[1].0 - pair[0].0) as f64 * (pair[0].1 + pair[1].1) / 2.0;
    until.windows(2).map(trapezoid).sum::<f64>() / (last.0 - first.0) as f64
}

/// Steps before the first evaluation of at least `threshold`, if there is one up to `horizon`.
pub(super) fn steps_to(curve: &Points, threshold: f64, horizon: u64) -> Option<u64> {
    let reached = |point: &&(u64, f64)| point.1 >= threshold;
    before(curve, horizon)
        .iter()
        .find(reached)
        .map(|(step, _)| *step)
}

/// The evaluations up to `horizon` steps, at least one.
fn before(curve: &Points, horizon: u64) -> &Points {
    let count = curve.partition_point(|(step, _)| *step <= horizon);
    &curve[..count.max(1)]
}

#[cfg(test)]
mod tests {
    use super::*;

    const CURVE: [(u64, f64); 5] = [(0, 1.0), (10, 3.0), (30, 5.0), (38, 7.0), (40, 9.0)];

    #[test]
    fn the_final_value_is_the_mean_of_the_last_tenth() {
        assert_eq!(final_value(&CURVE, 40), 8.0);
        assert_eq!(final_value(&CURVE, 39), 7.0, "36 to 39");
        assert_eq!(final_value(&CURVE, 29), 3.0, "none in the last tenth");
        assert_eq!(final_value(&CURVE[..1], 40), 1.0);
        assert_eq!(final_value(&CURVE[..1], 0), 1.0);
    }

    #[test]
    fn the_mean_height_is_that_of_straight_lines() {
        assert_eq!(mean_height(&CURVE, 30), (10.0 * 2.0 + 20.0 * 4.0) / 30.0);
        assert_eq!(mean_height(&CURVE, 35), (10.0 * 2.0 + 20.0 * 4.0) / 30.0);
        assert_eq!(mean_height(&CURVE[..1], 30), 1.0);
    }

    #[test]
    fn a_threshold_is_reached_at_an_evaluation() {
        assert_eq!(steps_to(&CURVE, 1.0, 40), Some(0));
        assert_eq!(steps_to(&CURVE, 3.5, 40), Some(30));
        assert_eq!(steps_to(&CURVE, 9.0, 39), None);
        assert_eq!(steps_to(&CURVE, 9.5, 40), None);
    }
}
