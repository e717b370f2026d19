//! Sequences made of knots.

use super::{Interpolation, Shape};

/// Writes the sequence, which nothing bounds, that goes through `knots`, `[n, action_size]`, spread evenly from the first step to the last.
pub(super) fn spline(
    knots: &[f32],
    interpolation: Interpolation,
    shape: Shape,
    sequence: &mut [f32],
) {
    let width = shape.action_size;
    let last = knots.len() / width - 1;
    let knot = |i: usize, a: usize| knots[i.min(last) * width + a];
    for (t, action) in sequence.chunks_exact_mut(width).enumerate() {
        let position = match shape.horizon {
            1 => 0.0,
            horizon => t as f32 * last as f32 / (horizon - 1) as f32,
        };
        let (before, part) = (position as usize, position.fract());
        for (a, x) in action.iter_mut().enumerate() {
            let [p0, p1, p2, p3] = [
                knot(before.saturating_sub(1), a),
                knot(before, a),
                knot(before + 1, a),
                knot(before + 2, a),
            ];
            *x = match interpolation {
                Interpolation::Zero => p1,
                Interpolation::Linear => p1 + part * (p2 - p1),
                Interpolation::Cubic => {
                    let (m1, m2) = (0.5 * (p2 - p0), 0.5 * (p3 - p1));
                    let (s, ss) = (part, part * part);
                    let sss = ss * s;
                    (2.0 * sss - 3.0 * ss + 1.0) * p1
                        + (sss - 2.0 * ss + s) * m1
                        + (3.0 * ss - 2.0 * sss) * p2
                        + (sss - ss) * m2
                }
            };
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn through(interpolation: Interpolation) -> Vec<f32> {
        let shape = Shape {
            horizon: 5,
            action_size: 1,
            episode: 10,
        };
        let mut sequence = vec![9.0; 5];
        spline(&[0.0, 0.8, -0.4], interpolation, shape, &mut sequence);
        sequence
    }

    #[test]
    fn every_kind_goes_through_the_knots() {
        assert_eq!(through(Interpolation::Zero), [0.0, 0.0, 0.8, 0.8, -0.4]);
        let linear = through(Interpolation::Linear);
        for (x, expected) in linear.iter().zip([0.0, 0.4, 0.8, 0.2, -0.4]) {
            assert!((x - expected).abs() < 1e-6, "{linear:?}");
        }
        let cubic = through(Interpolation::Cubic);
        for (t, expected) in [(0, 0.0), (2, 0.8), (4, -0.4)] {
            assert!((cubic[t] - expected).abs() < 1e-6, "{cubic:?}");
        }
        // It bends: half way up it is above the straight line.
        assert!(cubic[1] > 0.45, "{cubic:?}");
    }
}
