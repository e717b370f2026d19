//! Poses of objects: seven numbers, position in metres and quaternion (w, x, y, z).

use super::Stream;
use super::noise::uniform;

/// Numbers of a pose.
pub const POSE: usize = 7;

/// A quaternion (w, x, y, z).
pub type Quaternion = [f64; 4];

/// `a` after `b`: the Hamilton product.
pub fn product(a: Quaternion, b: Quaternion) -> Quaternion {
    [
        a[0] * b[0] - a[1] * b[1] - a[2] * b[2] - a[3] * b[3],
        a[0] * b[1] + a[1] * b[0] + a[2] * b[3] - a[3] * b[2],
        a[0] * b[2] - a[1] * b[3] + a[2] * b[0] + a[3] * b[1],
        a[0] * b[3] + a[1] * b[2] - a[2] * b[1] + a[3] * b[0],
    ]
}

/// The rotation by `angle` radians about a unit `axis`.
pub fn rotation(angle: f64, axis: [f64; 3]) -> Quaternion {
    let (sin, cos) = (angle / 2.0).sin_cos();
    [cos, axis[0] * sin, axis[1] * sin, axis[2] * sin]
}

/// A rotation by an angle uniform in +-pi about an axis of three uniforms in +-1, normalised (which
/// is not uniform on the sphere; so the published tasks draw it).
pub fn random_rotation(rng: &mut Stream) -> Quaternion {
    use std::f64::consts::PI;
    let angle = uniform(rng, -PI, PI);
    let axis = [0; 3].map(|_| uniform(rng, -1.0, 1.0));
    let norm = axis.iter().map(|x| x * x).sum::<f64>().sqrt();
    if norm == 0.0 {
        return [1.0, 0.0, 0.0, 0.0];
    }
    rotation(angle, axis.map(|x| x / norm))
}

/// Distance of two poses: of their positions in metres, and of their orientations in radians,
/// `2 arccos(w)` with w the first number of `a` times the conjugate of `b`.
///
/// The published tasks take no absolute value of w, so q and -q differ and the angle runs to 2 pi.
/// Quaternions need not be normalised (a model's predictions are not).
pub fn distance(a: &[f64; POSE], b: &[f64; POSE]) -> (f64, f64) {
    let position = (0..3).map(|i| (a[i] - b[i]).powi(2)).sum::<f64>().sqrt();
    let dot = |x: &[f64; POSE], y: &[f64; POSE]| (3..POSE).map(|i| x[i] * y[i]).sum::<f64>();
    let norms = dot(a, a) * dot(b, b);
    let w = if norms > 0.0 {
        dot(a, b) / norms.sqrt()
    } else {
        0.0
    };
    (position, 2.0 * w.clamp(-1.0, 1.0).acos())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::core::random::stream;
    use std::f64::consts::PI;

    #[test]
    fn opposite_quaternions_are_a_full_turn_apart() {
        let a = [0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0];
        let mut b = a;
        assert_eq!(distance(&a, &b), (0.0, 0.0));
        b[3] = -1.0;
        assert_eq!(distance(&a, &b), (0.0, 2.0 * PI));
        b[..3].copy_from_slice(&[3.0, 4.0, 0.0]);
        b[3..].copy_from_slice(&rotation(0.5, [0.0, 0.0, 1.0]));
        let (position, angle) = distance(&a, &b);
        assert!((position - 5.0).abs() < 1e-12 && (angle - 0.5).abs() < 1e-12);
    }

    #[test]
    fn random_rotations_turn_either_way_and_have_no_negative_w() {
        let mut rng = stream(0, "pose");
        let drawn: Vec<Quaternion> = (0..1000).map(|_| random_rotation(&mut rng)).collect();
        for q in &drawn {
            assert!(q[0] >= 0.0);
            assert!((q.iter().map(|x| x * x).sum::<f64>() - 1.0).abs() < 1e-12);
        }
        let mean = drawn.iter().map(|q| q[1]).sum::<f64>() / 1000.0;
        assert!(mean.abs() < 0.05, "{mean}");
    }

    #[test]
    fn products_compose_rotations() {
        let z = [0.0, 0.0, 1.0];
        let both = product(rotation(0.3, z), rotation(0.4, z));
        let once = rotation(0.7, z);
        assert!(both.iter().zip(&once).all(|(a, b)| (a - b).abs() < 1e-12));
    }
}
