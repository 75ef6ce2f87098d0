//! Poses of a photo from the points that it sees, three at a time.

use crate::bundle::Bundle;
use crate::minimal::three_points;
use weaver_geometry::Pose;
use weaver_geometry::glam::{DVec2, DVec3};
use weaver_kernels::random::Stream;

/// Most and fewest samples of three points.
const MOST: usize = 400;
const LEAST: usize = 30;
/// Probability of having drawn three right ones by the end.
const SURE: f64 = 0.999;
/// Numbers that are drawn for a sample: three have to differ.
const DRAWS: u64 = 8;
/// Candidate poses that are kept.
const KEPT: usize = 2;

/// A point, the camera that sees it, its pixel there without distortion, and the largest residual, pixels.
#[derive(Clone, Copy, Debug)]
pub(super) struct Sight {
    pub point: DVec3,
    pub camera: usize,
    pub pixel: DVec2,
    pub within: f64,
}

/// The poses of a camera, or of the first of a rig, that most sights support, the best first.
///
/// Source: Fischler and Bolles, "Random sample consensus" (1981).
pub(super) fn resected(sights: &[Sight], rig: &Bundle) -> Vec<Pose> {
    let n = sights.len();
    if n < 4 {
        return Vec::new();
    }
    let turns: Vec<_> = (0..rig.cameras.len()).map(|camera| rig.mounted(camera).rotation).collect();
    let ray = |s: &Sight| turns[s.camera].transpose() * rig.cameras[s.camera].intrinsics.unproject(s.pixel, 1.0);
    let rays: Vec<DVec3> = sights.iter().map(|s| ray(s).normalize()).collect();
    let support = |pose: &Pose| -> (f64, usize) {
        sights.iter().fold((0.0, 0), |(sum, count), s| {
            let p = turns[s.camera] * pose.apply(s.point);
            let far = rig.cameras[s.camera].intrinsics.project(p).distance_squared(s.pixel) / (s.within * s.within);
            if p.z > 0.0 && far < 1.0 { (sum + 1.0 - far, count + 1) } else { (sum, count) }
        })
    };
    let stream = Stream::new(n as u64, 0, "sfm.three_points");
    let mut kept: Vec<(Pose, f64)> = Vec::new();
    let mut needed = MOST;
    let mut sample = 0;
    while sample < needed {
        let first = DRAWS * sample as u64;
        let mut chosen: Vec<usize> = Vec::with_capacity(3);
        for draw in first..first + DRAWS {
            let i = stream.below(draw, n);
            if chosen.len() < 3 && !chosen.contains(&i) {
                chosen.push(i);
            }
        }
        sample += 1;
        let Ok(chosen) = <[usize; 3]>::try_from(chosen) else { continue };
        for pose in three_points(&chosen.map(|i| sights[i].point), &chosen.map(|i| rays[i])) {
            let (score, agree) = support(&pose);
            if kept.first().is_none_or(|best| score > best.1) {
                let missed = (1.0 - (agree as f64 / n as f64).powi(3)).clamp(1e-9, 1.0 - 1e-9);
                needed = (((1.0 - SURE).ln() / missed.ln()).ceil() as usize).clamp(LEAST, MOST);
            }
            kept.insert(kept.partition_point(|k| k.1 >= score), (pose, score));
            kept.truncate(KEPT);
        }
    }
    kept.into_iter().map(|(pose, _)| pose).collect()
}
