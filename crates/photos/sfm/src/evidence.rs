//! The evidence before the first camera is placed, and the trust in it.

use crate::features::Features;
use crate::pairs::Pair;
use crate::tracks::Track;

/// Largest residual of an observation that fits, in deviations of keypoints.
pub(crate) const FITS: f64 = 4.0;
/// Explanations are compared by observations within this tolerance, in deviations of keypoints: a wrong focal length
/// explains as many, but less exactly.
pub(crate) const EXACT: f64 = 0.5;
/// Steps of an adjustment while a scene grows.
pub(crate) const STEPS: usize = 12;

/// Evidence before the first camera is placed.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Evidence<'a> {
    pub features: &'a [Features],
    pub pairs: &'a [Pair],
    pub tracks: &'a [Track],
    /// True for photos that take no part.
    pub absent: &'a [bool],
    pub trust: Trust,
}

/// Evidence required for a photo's place.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Trust {
    /// The fewest points that must fit.
    pub fewest: usize,
    /// The least share of the points in its view that must fit.
    pub share: f64,
    /// True if matches with placed photos are enough, where they have no points in common.
    pub matches_alone: bool,
}

impl Trust {
    /// In pairs that are certain, or where few photos leave no choice.
    pub const PAIRS: Self = Self { fewest: 12, share: 0.25, matches_alone: true };
    /// In points only: pairs may be chance.
    pub const POINTS: Self = Self { fewest: 25, share: 0.5, matches_alone: false };
}
