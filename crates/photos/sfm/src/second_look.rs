//! A second look at photos that own features leave out, and at scenes that they leave in doubt, with the matches of a
//! learned matcher.

mod again;
mod extended;
mod register;

use crate::features::Features;
use crate::learned::{LearnedFeatures, LearnedMatch, LearnedMatcher};
use crate::lenses::Taken;
use crate::photo::{EstimateOptions, Photo};
pub(crate) use again::{again, better};
pub(crate) use register::register;

/// Longest sides between which photos are resized: the network learned from photos of such sizes, and larger ones take
/// longer.
const SIDES: [f64; 2] = [640.0, 1024.0];
/// Learned keypoints of a photo, at most, and the least probability of a match.
const KEYPOINTS: usize = 1024;
const PROBABLE: f32 = 0.1;

/// Photos of one search.
#[derive(Clone, Copy)]
pub(crate) struct Given<'a> {
    pub taken: &'a [Taken],
    pub photos: &'a [&'a Photo<'a>],
    pub features: &'a [Features],
    pub settings: &'a EstimateOptions,
}

/// A matcher of pairs of photos for which own features do not suffice.
pub trait PairMatcher: Sync {
    /// The features of a photo.
    fn features_of(&self, photo: &Photo<'_>) -> LearnedFeatures;

    /// The matches of two photos, by falling probability.
    fn matches_of(&self, first: &LearnedFeatures, second: &LearnedFeatures) -> Vec<LearnedMatch>;
}

impl PairMatcher for LearnedMatcher {
    fn features_of(&self, photo: &Photo<'_>) -> LearnedFeatures {
        let longer = photo.size[0].max(photo.size[1]).max(1) as f64;
        let factor = longer.clamp(SIDES[0], SIDES[1]) / longer;
        let shown = photo.size.map(|side| (side as f64 * factor).round() as usize);
        self.features_at((&photo.rgb, photo.size), shown, photo.mask, KEYPOINTS)
    }

    fn matches_of(&self, first: &LearnedFeatures, second: &LearnedFeatures) -> Vec<LearnedMatch> {
        self.matches(first, second, PROBABLE)
    }
}
