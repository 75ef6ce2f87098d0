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

/// Photos that find depth together: one, and so many of its neighbors.
const GROUP: usize = 3;

/// So many photos, in order, that find the depth of most that all of them show: groups of neighbors, each of which
/// shows the most points that no group before it does, a point counting as often as photos see it.
///
/// Evenly spread photos would be too far apart to agree about anything where few are chosen. `visible` are the points
/// that each photo sees. There are at least four, if there are as many photos, and fewer than `count` only where the
/// others have no neighbors.
///
/// ```
/// use weaver_geometry::Pose;
/// use weaver_scene::PointCloud;
/// use weaver_stereo::best_photos;
/// // Photos that share nothing with others find no depth.
/// let visible = vec![Vec::new(); 9];
/// assert!(best_photos(&[Pose::IDENTITY; 9], &PointCloud::default(), &visible, 5).is_empty());
/// ```
pub fn best_photos(poses: &[Pose], points: &PointCloud, visible: &[Vec<u32>], count: usize) -> Vec<usize> {
    if count >= poses.len() {
        return (0..poses.len()).collect();
    }
    let groups: Vec<Vec<usize>> = neighbors(poses, points, visible)
        .into_iter()
        .enumerate()
        .map(|(photo, near)| std::iter::once(photo).chain(near.into_iter().take(GROUP)).collect())
        .collect();
    let shown: Vec<Vec<usize>> = groups.iter().map(|group| shared(group, visible)).collect();
    let mut views = vec![0_usize; points.len()];
    visible.iter().flatten().for_each(|point| views[*point as usize] += 1);
    let mut chosen = vec![false; poses.len()];
    let mut left = count.max(GROUP + 1);
    // Points that are shown count again once no group shows others.
    let mut weights = views.clone();
    while left > 0 {
        let worth = |photo: usize| {
            let gain: usize = shown[photo].iter().map(|point| weights[*point]).sum();
            let cost = groups[photo].iter().filter(|photo| !chosen[**photo]).count();
            (gain > 0 && (1..=left).contains(&cost)).then(|| gain as f64 / cost as f64)
        };
        let best = (0..groups.len()).filter_map(|photo| Some((worth(photo)?, photo)));
        match best.max_by(|a, b| a.0.total_cmp(&b.0).then(b.1.cmp(&a.1))) {
            Some((_, best)) => {
                shown[best].iter().for_each(|point| weights[*point] = 0);
                for photo in &groups[best] {
                    left -= usize::from(!std::mem::replace(&mut chosen[*photo], true));
                }
            }
            None if weights == views => break,
            None => weights.clone_from(&views),
        }
    }
    (0..poses.len()).filter(|photo| chosen[*photo]).collect()
}

/// The points that two photos of a group see or more.
fn shared(group: &[usize], visible: &[Vec<u32>]) -> Vec<usize> {
    let mut seen: Vec<u32> = group.iter().flat_map(|photo| visible[*photo].iter().copied()).collect();
    seen.sort_unstable();
    let mut twice: Vec<u32> = seen.windows(2).filter(|pair| pair[0] == pair[1]).map(|pair| pair[0]).collect();
    twice.dedup();
    twice.into_iter().map(|point| point as usize).collect()
}

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
