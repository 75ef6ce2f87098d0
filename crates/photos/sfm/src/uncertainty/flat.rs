//! Scenes that a plane explains.

use crate::bundle::Bundle;
use weaver_geometry::glam::{DMat3, DVec3};

/// A plane explains points within this distance of their places on it, in deviations of keypoints, and a scene if it
/// explains at least this part of it.
const NEAR: f64 = 1.0;
const NEARLY_ALL: f64 = 0.9;
/// Rounds of a fit that rejects outliers, and the threshold, in medians.
const ROUNDS: usize = 6;
const FAR: f64 = 5.0;

impl Bundle {
    /// True if nearly all points fit their observations when moved onto one plane.
    ///
    /// Seen from one camera, inverse depths of points on a plane are linear in their rays.
    pub(super) fn flat(&self) -> bool {
        let Some(first) = self.cameras.first().map(|camera| camera.pose) else { return false };
        let seen: Vec<DVec3> = self.points.iter().map(|point| first.apply(*point)).collect();
        let rays: Vec<(DVec3, f64)> =
            seen.iter().filter(|p| p.z > 0.0).map(|p| (DVec3::new(p.x, p.y, p.z) / p.z, 1.0 / p.z)).collect();
        let mut farthest = f64::INFINITY;
        let mut plane = DVec3::ZERO;
        for _ in 0..ROUNDS {
            let (mut squares, mut products) = (DMat3::ZERO, DVec3::ZERO);
            for (ray, inverse) in rays.iter().filter(|(ray, inverse)| (plane.dot(*ray) - inverse).abs() <= farthest) {
                squares += DMat3::from_cols(*ray * ray.x, *ray * ray.y, *ray * ray.z);
                products += *ray * *inverse;
            }
            plane = squares.inverse() * products;
            if !plane.is_finite() {
                return false;
            }
            let mut off: Vec<f64> = rays.iter().map(|(ray, inverse)| (plane.dot(*ray) - inverse).abs()).collect();
            off.sort_unstable_by(f64::total_cmp);
            farthest = FAR * off.get(off.len() / 2).copied().unwrap_or(0.0);
        }
        let back = first.inverse();
        let on_plane = |p: &DVec3| back.apply(*p / plane.dot(*p));
        let flattened = Self { points: seen.iter().map(on_plane).collect(), ..self.clone() };
        let errors = flattened.errors();
        let near = errors.iter().zip(&self.observations).filter(|(error, o)| **error <= NEAR * o.deviation).count();
        near as f64 >= NEARLY_ALL * self.observations.len() as f64
    }
}
