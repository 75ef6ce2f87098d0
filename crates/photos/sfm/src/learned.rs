//! Learned features and a learned matcher, for pairs of photos that own features leave without a clear answer.
//!
//! Both are convolutions and attention on slices, without gradients. Their weights come from the caller: this crate
//! opens no files.

mod assignment;
mod matcher;
mod nearest;
mod sample;
mod weights;
mod xfeat;

use matcher::Matcher;
pub(crate) use nearest::nearest_matches;
use weights::Reader;
pub use weights::WeightsFault;
use xfeat::Extractor;

/// Shape and numbers of a tensor, or words for what was found in place of it.
pub type FoundTensor = Result<(Vec<usize>, Vec<f32>), String>;

/// Numbers of a learned descriptor.
pub const LEARNED_DESCRIPTOR: usize = 64;

/// Learned features of a photo.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct LearnedFeatures {
    /// Height and width of the photo.
    pub size: [usize; 2],
    /// Width and height of a pixel as the network sees the photo, pixels of the photo.
    pub pixel: [f32; 2],
    /// Places `[x, y]` of `N` keypoints by falling score, pixels of the photo, as the original counts them: the center
    /// of the network's first pixel is 0, where it is half of [`pixel`](Self::pixel) from the corner.
    pub points: Vec<[f32; 2]>,
    /// Scores from 0 to 1: how likely a place is a keypoint, times how reliable its descriptor is.
    pub scores: Vec<f32>,
    /// `[N, 64]`, of length 1.
    pub descriptors: Vec<f32>,
}

/// Two keypoints that a learned matcher takes for the same point.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LearnedMatch {
    /// Number of the keypoint in the first photo.
    pub first: u32,
    /// Number of the keypoint in the second photo.
    pub second: u32,
    /// The matcher's probability.
    pub score: f32,
}

/// XFeat and LighterGlue with their weights.
///
/// XFeat is a small convolutional network that finds keypoints with descriptors in gray photos. LighterGlue is a
/// transformer of six layers that looks at the keypoints of two photos together and says which are the same.
///
/// Sources: Potje, Cadar, Araujo, Martins and Nascimento, XFeat: Accelerated Features for Lightweight Image Matching,
/// 2024; Lindenberger, Sarlin and Pollefeys, LightGlue: Local Feature Matching at Light Speed, 2023.
#[derive(Clone, Debug)]
pub struct LearnedMatcher {
    extractor: Extractor,
    matcher: Matcher,
}

impl LearnedMatcher {
    /// The networks with the weights that `tensor` returns by name, with their shapes, or words for what it found in
    /// place of one: the names of `xfeat.pt`, and the names of `xfeat-lighterglue.pt` that begin with `matcher.`.
    ///
    /// ```
    /// use weaver_sfm::LearnedMatcher;
    /// let fault = LearnedMatcher::new(&|_| Err("no such tensor".into())).unwrap_err();
    /// assert_eq!(fault.to_string(), "skip1.1.weight: expected [24, 1, 1, 1], found no such tensor");
    /// ```
    ///
    /// # Errors
    /// Names the first tensor that is missing, has another shape, or holds numbers that are not finite.
    pub fn new(tensor: &dyn Fn(&str) -> FoundTensor) -> Result<Self, WeightsFault> {
        let reader = Reader { tensor };
        Ok(Self { extractor: Extractor::read(&reader)?, matcher: Matcher::read(&reader)? })
    }

    /// The features of a photo in sRGB `[height, width, 3]`, at most `most`; none where `mask` `[height, width]` is
    /// false. A photo with a side below 32 pixels has none.
    ///
    /// # Panics
    /// If `rgb` (or `mask`) is not as large as `size` says.
    pub fn features(&self, rgb: &[u8], size: [usize; 2], mask: Option<&[bool]>, most: usize) -> LearnedFeatures {
        let [height, width] = size;
        assert_eq!(rgb.len(), 3 * width * height, "learned features: a photo of {width}x{height}");
        assert!(mask.is_none_or(|m| 3 * m.len() == rgb.len()), "learned features: a mask of {width}x{height}");
        self.extractor.features((rgb, size), size, mask, most)
    }

    /// The same features of a photo that the network sees at another size, as if it had been resized.
    pub(crate) fn features_at(
        &self,
        (rgb, size): (&[u8], [usize; 2]),
        shown: [usize; 2],
        mask: Option<&[bool]>,
        most: usize,
    ) -> LearnedFeatures {
        self.extractor.features((rgb, size), shown, mask, most)
    }

    /// The matches of two photos with a probability above `least`, by falling probability.
    pub fn matches(&self, first: &LearnedFeatures, second: &LearnedFeatures, least: f32) -> Vec<LearnedMatch> {
        self.matcher.matches(first, second, least)
    }
}
