//! Poses from three points.

use super::polynomial::roots;
use weaver_geometry::Pose;
use weaver_geometry::glam::{DMat3, DVec3};

/// The poses from which three points are seen along three rays of unit length, up to four.
///
/// With distances s1, s2 = u s1, s3 = v s1 to the points, the law of cosines for each two leaves a polynomial of degree
/// four in v.
///
/// Source: Haralick, Lee, Ottenberg and Nölle, "Review and analysis of solutions of the three point perspective pose
/// estimation problem" (1994), Grunert's solution.
pub(crate) fn three_points(points: &[DVec3; 3], rays: &[DVec3; 3]) -> Vec<Pose> {
    // Squared sides opposite each point, and cosines between the other two rays.
    let side = |i: usize, j: usize| points[i].distance_squared(points[j]);
    let (a2, b2, c2) = (side(1, 2), side(0, 2), side(0, 1));
    let cosine = |i: usize, j: usize| rays[i].dot(rays[j]);
    let (alpha, beta, gamma) = (cosine(1, 2), cosine(0, 2), cosine(0, 1));
    if a2.min(b2).min(c2) <= 0.0 {
        return Vec::new();
    }
    let (p, q, r, s) = ((a2 - c2) / b2, (a2 + c2) / b2, c2 / b2, a2 / b2);
    let quartic = [
        (1.0 + p).powi(2) - 4.0 * s * gamma * gamma,
        4.0 * (-p * (1.0 + p) * beta + 2.0 * s * gamma * gamma * beta - (1.0 - q) * alpha * gamma),
        2.0 * (p * p - 1.0 + 2.0 * p * p * beta * beta + 2.0 * (1.0 - r) * alpha * alpha
            - 4.0 * q * alpha * beta * gamma
            + 2.0 * (1.0 - s) * gamma * gamma),
        4.0 * (p * (1.0 - p) * beta - (1.0 - q) * alpha * gamma + 2.0 * r * alpha * alpha * beta),
        (p - 1.0).powi(2) - 4.0 * r * alpha * alpha,
    ];
    let pose = |v: f64| {
        let u = ((p - 1.0) * v * v - 2.0 * p * beta * v + 1.0 + p) / (2.0 * (gamma - v * alpha));
        let first = (b2 / (1.0 + v * v - 2.0 * v * beta)).sqrt();
        let distances = [first, u * first, v * first];
        let ahead = distances.iter().all(|s| s.is_finite() && *s > 0.0);
        ahead.then(|| onto(points, &std::array::from_fn(|i| rays[i] * distances[i])))?
    };
    roots(&quartic).into_iter().filter_map(pose).collect()
}

/// The motion that takes three points to three others, as far away from each other.
fn onto(from: &[DVec3; 3], to: &[DVec3; 3]) -> Option<Pose> {
    let frame = |of: &[DVec3; 3]| {
        let x = (of[1] - of[0]).try_normalize()?;
        let z = x.cross(of[2] - of[0]).try_normalize()?;
        Some(DMat3::from_cols(x, z.cross(x), z))
    };
    let rotation = frame(to)? * frame(from)?.transpose();
    Some(Pose::new(rotation, to[0] - rotation * from[0]))
}

#[cfg(test)]
mod tests {
    use super::*;
    use weaver_geometry::so3;
    use weaver_kernels::random::Stream;

    #[test]
    fn the_true_pose_is_among_those_that_are_found() {
        let mut missed = 0;
        for seed in 0..300 {
            let stream = Stream::new(seed, 0, "test.three_points");
            let draw = |k: u64| DVec3::new(stream.normal(k), stream.normal(k + 1), stream.normal(k + 2));
            let truth = Pose::new(so3::exp(draw(0)), draw(3));
            let seen: [DVec3; 3] = std::array::from_fn(|k| draw(10 + 3 * k as u64) + DVec3::Z * 6.0);
            let points = seen.map(|p| truth.inverse().apply(p));
            let found = three_points(&points, &seen.map(DVec3::normalize));
            for pose in &found {
                let off = |i: usize| pose.apply(points[i]).angle_between(seen[i]);
                assert!((0..3).all(|i| off(i) < 1e-5), "seed {seed}");
            }
            let near = |pose: &Pose| pose.angle_to(&truth) < 1e-5 && pose.center().distance(truth.center()) < 1e-4;
            missed += usize::from(!found.iter().any(near));
        }
        assert!(missed <= 3, "{missed} of 300 missed");
    }

    /// Points on a line or in one place give no numbers that are none.
    #[test]
    fn degenerate_points_give_finite_numbers() {
        let rays = [DVec3::Z, DVec3::new(0.1, 0.0, 1.0).normalize(), DVec3::new(0.2, 0.0, 1.0).normalize()];
        for points in [[DVec3::Z; 3], [DVec3::ZERO, DVec3::X, 2.0 * DVec3::X]] {
            assert!(three_points(&points, &rays).iter().all(|pose| pose.rotation.is_finite()));
        }
    }
}
