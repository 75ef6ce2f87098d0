//! Points from observations by several cameras.

use weaver_geometry::Camera;
use weaver_geometry::glam::{DMat3, DVec2, DVec3};

/// Least sine of the angle between rays of a point.
const PARALLAX: f64 = 0.005;

/// The point that most observations of a track agree on to `farthest` pixels; at least two must.
pub(crate) fn agreed(seen: &[(Camera, DVec2)], farthest: f64) -> Option<DVec3> {
    const TRIED: usize = 6;
    let near = |point: DVec3| -> Vec<(Camera, DVec2)> {
        seen.iter().filter(|(camera, pixel)| error(camera, point, *pixel) < farthest).copied().collect()
    };
    let tried = seen.len().min(TRIED);
    let pairs = (0..tried).flat_map(|i| (0..i).map(move |j| [i, j]));
    let candidates = pairs.filter_map(|pair| triangulated(&pair.map(|i| seen[i]))).chain(triangulated(seen));
    let best = candidates.map(near).max_by_key(Vec::len)?;
    triangulated(&best)
}

/// Distance from a pixel to the projection of a point.
pub(crate) fn error(camera: &Camera, point: DVec3, pixel: DVec2) -> f64 {
    let p = camera.pose.apply(point);
    if p.z > 0.0 { camera.intrinsics.project(p).distance(pixel) } else { f64::INFINITY }
}

/// The point nearest to all rays; `None` behind a camera, or where rays are nearly parallel.
pub(crate) fn triangulated(seen: &[(Camera, DVec2)]) -> Option<DVec3> {
    let (mut matrix, mut sum) = (DMat3::ZERO, DVec3::ZERO);
    let rays: Vec<(DVec3, DVec3)> = seen
        .iter()
        .map(|(camera, pixel)| {
            let ray = camera.pose.rotation.transpose() * camera.intrinsics.unproject(*pixel, 1.0);
            (camera.pose.center(), ray.normalize())
        })
        .collect();
    for (center, ray) in &rays {
        let across = DMat3::IDENTITY - DMat3::from_cols(*ray * ray.x, *ray * ray.y, *ray * ray.z);
        matrix += across;
        sum += across * *center;
    }
    let widest = rays.iter().map(|(_, ray)| ray.cross(rays[0].1).length()).fold(0.0, f64::max);
    let point = matrix.inverse() * sum;
    let before = seen.iter().all(|(camera, _)| camera.pose.apply(point).z > 0.0);
    (seen.len() > 1 && widest > PARALLAX && before && point.is_finite()).then_some(point)
}
