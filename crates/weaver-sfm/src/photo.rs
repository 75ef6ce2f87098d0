//! Photos whose cameras are estimated, and how.

use crate::features::gray;

/// A photo without a camera.
#[derive(Clone, Debug)]
pub struct Photo<'a> {
    /// Gray, from 0 to 1, `[height, width]`.
    pub gray: Vec<f32>,
    /// Height and width.
    pub size: [usize; 2],
    /// What of it counts, `[height, width]`: 0 where masked.
    pub mask: Option<&'a [u8]>,
    /// The focal length, pixels, as far as it is told. Where others tell theirs, it is taken to be as theirs.
    pub focal: Option<f64>,
    /// Whether the other cameras and the points are found without it: it is located in what they found.
    pub located: bool,
}

impl Photo<'_> {
    /// A photo in sRGB, `[height, width, 3]`, whose mean of colors is taken for gray.
    pub fn new(rgb: &[u8], size: [usize; 2]) -> Self {
        Self { gray: gray(rgb), size, mask: None, focal: None, located: false }
    }
}

/// How cameras are estimated.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct EstimateSettings {
    /// Keypoints of a photo, at most.
    pub keypoints: usize,
    /// Photos that each is compared with, at most: those that look most alike.
    pub candidates: usize,
    /// How wrong known focal lengths may be, as a part of them; 0 keeps them.
    pub focal_deviation: f64,
    /// Whether all photos have one factor of their focal lengths, rather than each its own.
    pub shared: bool,
    /// Whether a radial distortion is found.
    pub distortion: bool,
}

impl Default for EstimateSettings {
    fn default() -> Self {
        Self { keypoints: 3000, candidates: 20, focal_deviation: 0.05, shared: true, distortion: false }
    }
}

/// The median of the focal lengths that are told, over the longer sides of their photos.
pub(crate) fn told(photos: &[Photo<'_>]) -> Option<f64> {
    let longer = |p: &Photo<'_>| p.size[0].max(p.size[1]) as f64;
    let mut told: Vec<f64> = photos.iter().filter_map(|p| Some(p.focal? / longer(p))).collect();
    told.sort_by(f64::total_cmp);
    told.get(told.len() / 2).copied()
}
