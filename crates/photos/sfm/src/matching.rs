//! Matches between the keypoints of two photos.

mod near;

use crate::descriptor::{DESCRIPTOR, LENGTH};
use crate::epipolar::Epipolar;
use crate::features::Features;
pub(crate) use near::Near;
use weaver_kernels::byte_products::{TopTwo, chosen_products, top_products};

/// Largest distance to the best keypoint over the distance to the second best.
const RATIO: f32 = 0.85;
/// Similarity of unrelated keypoints: the second best is taken to be at least as similar, where few candidates are
/// left.
const STRANGERS: f32 = 0.3;

/// Two similar keypoints.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Match {
    /// Number of the keypoint in the first photo.
    pub first: u32,
    /// Number of the keypoint in the second photo.
    pub second: u32,
    /// Distance over the distance to the second best keypoint; the smaller, the less ambiguous.
    pub ratio: f32,
}

impl Match {
    /// The numbers of the keypoints in the first photo and in the second.
    pub fn numbers(&self) -> [usize; 2] {
        [self.first as usize, self.second as usize]
    }
}

/// The pairs of keypoints that are each other's best, and in the second photo clearly better than all others (distance
/// below 0.85 of the second smallest); the clearest first.
///
/// Products of descriptors are whole numbers, so that the matches are the same with every instruction set. Where two
/// keypoints of the first photo have the same best one, as similar to both, the first of them is taken.
///
/// Source: Lowe, Distinctive image features from scale-invariant keypoints, 2004, section 7.1.
pub fn matches(first: &Features, second: &Features) -> Vec<Match> {
    let (n, m) = (first.keypoints.len(), second.keypoints.len());
    let mut best = vec![TopTwo::default(); n];
    let mut of_second = vec![0; m];
    top_products(DESCRIPTOR, &first.descriptors, &second.descriptors, &mut best, &mut of_second);
    mutual(&best, of_second)
}

/// Matches as [`matches()`] finds them, among the keypoints near each other's epipolar lines alone: keypoints that the
/// cameras rule out are no rivals.
pub fn matches_along(first: &Features, second: &Features, epipolar: &Epipolar) -> Vec<Match> {
    Near::new(second).matches(first, epipolar)
}

impl Near {
    /// Matches of a photo with this one, as [`matches_along`] finds them.
    pub fn matches(&self, first: &Features, epipolar: &Epipolar) -> Vec<Match> {
        let mut best = vec![TopTwo::default(); first.keypoints.len()];
        let mut of_second = vec![0; self.numbers.len()];
        let mut candidates = Vec::new();
        let mut products = vec![0; self.numbers.len()];
        let descriptors = first.descriptors.chunks_exact(DESCRIPTOR);
        for ((keypoint, descriptor), best) in first.keypoints.iter().zip(descriptors).zip(&mut best) {
            let count = self.band(epipolar.line(keypoint.pixel), epipolar.farthest(), &mut candidates);
            let candidates = &candidates[..count];
            let products = &mut products[..count];
            chosen_products(descriptor, &self.descriptors, candidates, products);
            // The larger of two keys belongs to the larger product, or to the first of equal ones.
            let mut top = [0_u64; 2];
            for (at, product) in candidates.iter().zip(products) {
                let number = self.numbers[*at as usize];
                let key = u64::from(*product) << 32 | u64::from(u32::MAX - number);
                top = [top[0].max(key), top[1].max(top[0].min(key))];
                let most: &mut u32 = &mut of_second[number as usize];
                *most = (*most).max(*product);
            }
            let column = if candidates.is_empty() { 0 } else { u32::MAX - top[0] as u32 };
            *best = TopTwo { column, first: (top[0] >> 32) as u32, second: (top[1] >> 32) as u32 };
        }
        mutual(&best, of_second)
    }
}

/// The clear ones among the best of the first photo, which are best for the second photo's keypoints, too.
fn mutual(best: &[TopTwo], mut of_second: Vec<u32>) -> Vec<Match> {
    let distance = |similarity: f32| (2.0 - 2.0 * similarity).max(1e-12).sqrt();
    let similarity = |product: u32| product as f32 / (LENGTH * LENGTH);
    let mut matches = Vec::new();
    for (first, top) in best.iter().enumerate() {
        let Some(most) = of_second.get_mut(top.column as usize) else { continue };
        // Nothing in common with anything is no match.
        if top.first == 0 || *most != top.first {
            continue;
        }
        *most = u32::MAX;
        let ratio = distance(similarity(top.first)) / distance(similarity(top.second).max(STRANGERS));
        if ratio < RATIO {
            matches.push(Match { first: first as u32, second: top.column, ratio });
        }
    }
    matches.sort_by(|a, b| a.ratio.total_cmp(&b.ratio));
    // With a thousand photos, unused capacity would be a good part of all memory.
    matches.shrink_to_fit();
    matches
}
