//! The world that estimated cameras were brought to.

use serde::{Deserialize, Serialize};
use weaver_geometry::geodesy::Origin;

/// The world that estimated cameras were brought to, and the sources of it.
#[derive(Clone, Debug, Default, Deserialize, PartialEq, Serialize)]
pub struct Placement {
    /// True if the world has meters.
    pub meters: bool,
    /// True if its axes are east, north and up; otherwise y is down, as in photos.
    pub east_north_up: bool,
    /// The source of the vertical: `positions`, `gimbal`, `ground`, `cameras`; `None` if nothing determines it.
    pub vertical: Option<String>,
    /// The origin on the Earth or in the frame of the positions.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub origin: Option<Origin>,
    /// Positions of cameras beside those that were given.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub positions: Option<PositionsFit>,
    /// The bar of known length.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub scale_bar: Option<BarFit>,
    /// Meters on the ground for each pixel of a photo, the median; `None` without meters.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub ground_sample: Option<f64>,
}

/// Positions of cameras beside those that were given.
#[derive(Clone, Debug, Default, Deserialize, PartialEq, Serialize)]
pub struct PositionsFit {
    /// `GPS`, or the file.
    pub source: String,
    /// Cameras with a position.
    pub cameras: usize,
    /// Those whose position fits the others.
    pub used: usize,
    /// Median distance from the given positions along the ground, meters, of all.
    pub median: f64,
    /// The largest distance of those that fit along the ground, meters.
    pub largest: f64,
    /// Median distance from the given heights, meters.
    pub height: f64,
    /// Deviation of the scale, as a part of it.
    pub scale_deviation: f64,
    /// Deviation of the vertical by the positions alone, degrees.
    pub level_deviation: f64,
    /// True if the world follows them; false if they are too coarse.
    pub followed: bool,
}

/// A bar of known length.
#[derive(Clone, Debug, Default, Deserialize, PartialEq, Serialize)]
pub struct BarFit {
    /// Its length, meters.
    pub length: f64,
    /// Its length in the world, meters: the same, unless positions set the scale; 0 if fewer than two photos that show
    /// it have a camera.
    pub found: f64,
    /// Photos that show it.
    pub photos: usize,
    /// Root of the mean square distance of its ends from where the photos show them, pixels.
    pub error_pixels: f64,
}
