//! Choice of the photos by which the depth of a photo is found.

use std::collections::BTreeMap;
use weaver_geometry::Pose;
use weaver_geometry::glam::DVec3;
use weaver_scene::PointCloud;

/// The angle between the rays of two photos at which depth is measured best, radians, and the decay below it and above.
const ANGLE: f64 = 8.0_f64.to_radians();
const NARROW: f64 = 4.0_f64.to_radians();
const WIDE: f64 = 12.0_f64.to_radians();
/// Photos that share less are no neighbors.
const LEAST_SCORE: f64 = 5.0;

/// The neighbors of each photo, the best first: photos that share points with it under angles good for depth.
pub(crate) fn neighbors(poses: &[Pose], points: &PointCloud, visible: &[Vec<u32>]) -> Vec<Vec<usize>> {
    let mut seen_by: Vec<Vec<usize>> = vec![Vec::new(); points.len()];
    for (photo, seen) in visible.iter().enumerate() {
        seen.iter().for_each(|point| seen_by[*point as usize].push(photo));
    }
    let centers: Vec<DVec3> = poses.iter().map(Pose::center).collect();
    let mut scores: Vec<BTreeMap<usize, f64>> = vec![BTreeMap::new(); poses.len()];
    for (point, photos) in points.positions.iter().zip(&seen_by) {
        let point = DVec3::from(point.map(f64::from));
        for (k, &a) in photos.iter().enumerate() {
            for &b in &photos[k + 1..] {
                let angle = (centers[a] - point).angle_between(centers[b] - point);
                let off = (angle - ANGLE) / if angle < ANGLE { NARROW } else { WIDE };
                let score = (-0.5 * off * off).exp();
                if score.is_finite() {
                    *scores[a].entry(b).or_default() += score;
                    *scores[b].entry(a).or_default() += score;
                }
            }
        }
    }
    let best = |scores: &BTreeMap<usize, f64>| {
        let mut near: Vec<(usize, f64)> = scores.iter().map(|(photo, score)| (*photo, *score)).collect();
        near.retain(|(_, score)| *score > LEAST_SCORE);
        near.sort_by(|a, b| b.1.total_cmp(&a.1).then(a.0.cmp(&b.0)));
        near.into_iter().map(|(photo, _)| photo).collect()
    };
    scores.iter().map(best).collect()
}
