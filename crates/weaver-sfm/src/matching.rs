//! Which keypoints of two photos are the same.

use crate::descriptor::DESCRIPTOR;
use crate::epipolar::Epipolar;
use crate::features::Features;
use weaver_kernels::gemm::{Mat, MatMut, gemm};

/// Largest distance to the best keypoint over that to the second best.
const RATIO: f32 = 0.85;
/// Similarity of keypoints that have nothing to do with each other: the second best is taken to be as similar at least, where
/// few come into question.
const STRANGERS: f32 = 0.3;
/// Keypoints of the first photo that are compared at once: their similarities stay in the cache.
const ROWS: usize = 128;

/// Two keypoints that look alike.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Match {
    /// Number of the keypoint in the first photo.
    pub first: usize,
    /// Number of the keypoint in the second photo.
    pub second: usize,
    /// Distance over that to the second best keypoint; the smaller, the less is it to be mistaken.
    pub ratio: f32,
}

/// The pairs of keypoints that are each other's best, and in the second photo clearly better than all others (distance
/// below 0.85 of the second smallest); the clearest first.
///
/// Source: Lowe, Distinctive image features from scale-invariant keypoints, 2004, section 7.1.
pub fn matches(first: &Features, second: &Features) -> Vec<Match> {
    found(first, second, None)
}

/// Matches as [`matches()`] finds them, among the keypoints near each other's epipolar lines alone: what cameras rule out is no rival.
pub fn matches_along(first: &Features, second: &Features, epipolar: &Epipolar) -> Vec<Match> {
    found(first, second, Some(epipolar))
}

fn found(first: &Features, second: &Features, epipolar: Option<&Epipolar>) -> Vec<Match> {
    let (n, m) = (first.keypoints.len(), second.keypoints.len());
    if n == 0 || m == 0 {
        return Vec::new();
    }
    let places: Vec<[f32; 2]> = second.keypoints.iter().map(|k| k.pixel.as_vec2().to_array()).collect();
    let others = Mat::new(&second.descriptors, m, DESCRIPTOR).transposed();
    let mut similar = vec![0.0; ROWS.min(n) * m];
    let mut best = Vec::with_capacity(n);
    let mut of_second = vec![f32::NEG_INFINITY; m];
    for (keypoints, descriptors) in first.keypoints.chunks(ROWS).zip(first.descriptors.chunks(ROWS * DESCRIPTOR)) {
        let rows = keypoints.len();
        let similar = &mut similar[..rows * m];
        gemm(1.0, Mat::new(descriptors, rows, DESCRIPTOR), others, 0.0, MatMut::new(similar, rows, m));
        for (keypoint, row) in keypoints.iter().zip(similar.chunks_exact_mut(m)) {
            if let Some(epipolar) = epipolar {
                let (line, farthest) = (epipolar.line(keypoint.pixel).as_vec3(), epipolar.farthest() as f32);
                for (s, [u, v]) in row.iter_mut().zip(&places) {
                    let far = (line.x * u + line.y * v + line.z).abs() > farthest;
                    *s = if far { f32::NEG_INFINITY } else { *s };
                }
            }
            let mut top = (0, f32::NEG_INFINITY, STRANGERS);
            for (j, s) in row.iter().enumerate() {
                if *s > top.1 {
                    top = (j, *s, top.1);
                } else if *s > top.2 {
                    top.2 = *s;
                }
            }
            best.push(top);
            of_second.iter_mut().zip(row).for_each(|(best, s)| *best = best.max(*s));
        }
    }
    let distance = |similarity: f32| (2.0 - 2.0 * similarity).max(1e-12).sqrt();
    let mut matches: Vec<Match> = (best.iter().enumerate())
        .filter(|(_, (j, s, _))| *s > f32::NEG_INFINITY && of_second[*j] == *s)
        .map(|(first, (second, s, next))| Match { first, second: *second, ratio: distance(*s) / distance(*next) })
        .filter(|m| m.ratio < RATIO)
        .collect();
    matches.sort_by(|a, b| a.ratio.total_cmp(&b.ratio));
    matches
}
