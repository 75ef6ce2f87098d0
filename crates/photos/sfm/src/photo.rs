//! Photos to estimate cameras of, and the settings.

use crate::bundle::Mounted;
use crate::features::{Features, gray};
use std::borrow::Cow;

/// A photo without a camera.
#[derive(Clone, Debug)]
pub struct Photo<'a> {
    /// sRGB, `[height, width, 3]`. Keypoints are found in the mean of its colors.
    pub rgb: Cow<'a, [u8]>,
    /// Height and width.
    pub size: [usize; 2],
    /// Mask of the pixels that count, `[height, width]`; `None` if all do.
    pub mask: Option<&'a [bool]>,
    /// The focal length, pixels, if it is given. Without one, it takes the focal length of the others: of the same lens
    /// or, if these have none, of all.
    pub focal: Option<f64>,
    /// Number of the lens that took it; numbers may have gaps. Photos of one lens share one factor of their focal
    /// lengths, distortion and principal point. Photos of one lens that were cropped to other proportions count as of
    /// another lens: the longer side of a crop is another part of the sensor.
    pub lens: usize,
    /// True if the other cameras and the points are found without it: it is then located in their scene.
    pub located: bool,
    /// Its place in a rig of photos, as the faces of a panorama; `None` if it stands alone. Photos of a rig follow one
    /// another, the first of them mounted on itself, and have one lens, which no other photo has. Their focal lengths
    /// are exact, if they are given, and all of a rig are [located](Self::located) or none.
    pub mounted: Option<Mounted>,
}

impl<'a> Photo<'a> {
    /// A photo in sRGB, `[height, width, 3]`, without any other information.
    pub fn new(rgb: impl Into<Cow<'a, [u8]>>, size: [usize; 2]) -> Self {
        Self { rgb: rgb.into(), size, mask: None, focal: None, lens: 0, located: false, mounted: None }
    }

    /// Its [`Features`], at most so many.
    pub fn features(&self, most: usize) -> Features {
        Features::new(&gray(&self.rgb), self.size, self.mask, most)
    }
}

/// The radial distortion to find: a point at distance r from the axis, over its depth, is seen at `r (1 + k1 r^2 + k2
/// r^4)`.
#[derive(Clone, Copy, Debug, Default, Eq, PartialEq)]
pub enum Find {
    /// None: both are 0.
    Off,
    /// k1, and of many photos k2, where photos determine them: where they are several of their standard deviations from
    /// 0.
    #[default]
    Told,
    /// k1.
    K1,
    /// k1 and k2.
    K1K2,
}

/// Settings of an estimate.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct EstimateOptions {
    /// Keypoints of a photo, at most.
    pub keypoints: usize,
    /// Photos that each is compared with, at most: the most similar ones.
    pub candidates: usize,
    /// True if photos were taken one after the other: each is then compared with its neighbors too.
    pub sequence: bool,
    /// Expected error of known focal lengths, as a part of them; 0 keeps them.
    pub focal_deviation: f64,
    /// The radial distortion to find.
    pub distortion: Find,
}

impl Default for EstimateOptions {
    fn default() -> Self {
        Self { keypoints: 3000, candidates: 20, sequence: false, focal_deviation: 0.05, distortion: Find::Told }
    }
}
