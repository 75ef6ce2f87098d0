//! The rules of drawing that can be chosen.

use crate::tiles::{Region, TileSide};

/// The rules of drawing that can be chosen.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RasterSettings {
    /// Gaussians whose mean is nearer than this along the optical axis are not drawn, world units.
    pub near: f64,
    /// Gaussians whose mean is farther than this along the optical axis are not drawn, world units.
    pub far: f64,
    /// Variance added to both image axes, pixels squared: a low-pass filter.
    pub eps2d: f64,
    /// Largest alpha of one Gaussian at one pixel.
    pub alpha_max: f64,
    /// True if the opacity is lowered by `sqrt(det S / det(S + eps2d I))`, which undoes the gain in size by the blur.
    pub antialiased: bool,
    /// Gaussians with three standard deviations of their longest image axis below this many pixels are not drawn;
    /// `None` draws all.
    pub radius_clip: Option<f64>,
    /// Side of the square tiles. A choice of speed: images do not depend on it.
    pub tile: TileSide,
    /// The part of each view to draw; `None` draws all of it.
    ///
    /// Images and their cotangents then have the region's size. They are the same bits as that part of the whole image,
    /// and gradients are the same as for the whole image with cotangents of zero outside the region.
    pub region: Option<Region>,
}

impl Default for RasterSettings {
    fn default() -> Self {
        Self {
            near: 0.01,
            far: 1e10,
            eps2d: 0.3,
            alpha_max: 0.99,
            antialiased: false,
            radius_clip: None,
            tile: TileSide::Sixteen,
            region: None,
        }
    }
}

/// Smallest antialiasing ratio of determinants; no gradient flows through it where it holds.
pub(crate) const RATIO_FLOOR: f64 = 0.005 * 0.005;
