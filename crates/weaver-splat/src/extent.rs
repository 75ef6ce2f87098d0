//! The sizes of a call, and whether its arguments fit together.

use crate::settings::{RasterError, RasterSettings};
use crate::tiles::Region;
use weaver_geometry::sh;
use weaver_kernels::Real;
use weaver_scene::{CameraSlices, Color, GaussianSlices};

/// The sizes of a call.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Extent {
    /// N.
    pub gaussians: usize,
    /// V.
    pub views: usize,
    /// Numbers per Gaussian's color.
    pub color_len: usize,
    /// C.
    pub channels: usize,
    /// Whether depth was asked for.
    pub depth: bool,
    /// What is drawn of each view.
    pub region: Region,
}

impl Extent {
    /// Pixels of all images together.
    pub fn pixels(&self) -> usize {
        self.views * self.region.pixels()
    }
}

/// `length == expected`, or an error that names the argument.
pub(crate) fn expect_len(name: &str, length: usize, expected: usize) -> Result<(), RasterError> {
    if length == expected {
        return Ok(());
    }
    Err(RasterError::new(format!("{name} has {length} numbers, expected {expected}")))
}

/// Checks that everything fits together.
pub(crate) fn extent<T: Real>(
    gaussians: &GaussianSlices<'_, T>,
    cameras: &CameraSlices<'_, T>,
    settings: &RasterSettings,
    depth: bool,
) -> Result<Extent, RasterError> {
    let (n, v) = (gaussians.opacities.len(), cameras.views());
    if let Color::Sh { degree, .. } = gaussians.color
        && degree > sh::MAX_DEGREE
    {
        return Err(RasterError::new(format!(
            "spherical harmonics of degree {degree}, the largest is {}",
            sh::MAX_DEGREE
        )));
    }
    let (colors, color_len) = gaussians.color.values();
    expect_len("means", gaussians.means.len(), 3 * n)?;
    expect_len("quats", gaussians.quats.len(), 4 * n)?;
    expect_len("scales", gaussians.scales.len(), 3 * n)?;
    expect_len("colors", colors.len(), color_len * n)?;
    let channels = gaussians.features.map_or(0, |features| features.channels);
    let features = gaussians.features.map_or(0, |features| features.values.len());
    expect_len("features", features, channels.saturating_mul(n))?;
    expect_len("intrinsics", cameras.intrinsics.len(), 4 * v)?;
    if cameras.viewmats.len() != 16 * v {
        expect_len("viewmats", cameras.viewmats.len(), 12 * v)?;
    }
    if cameras.background.len() != 3 {
        expect_len("background", cameras.background.len(), 3 * v)?;
    }
    if !cameras.background.iter().all(|x| x.is_finite()) {
        return Err(RasterError::new("the background holds a number that is not finite"));
    }
    let (width, height) = (cameras.width, cameras.height);
    if width == 0 || height == 0 || width > 1 << 20 || height > 1 << 20 {
        return Err(RasterError::new(format!("an image of {width} x {height} pixels")));
    }
    let region = settings.region.unwrap_or(Region::whole(width, height));
    if !region.is_within(width, height) {
        let Region { x, y, width: w, height: h } = region;
        return Err(RasterError::new(format!(
            "a region of {w} x {h} pixels at ({x}, {y}) is empty or reaches beyond the image of {width} x {height} pixels"
        )));
    }
    if v.checked_mul(n).is_none_or(|all| all >= u32::MAX as usize) {
        return Err(RasterError::new(format!("{v} views of {n} Gaussians are too many for one call")));
    }
    Ok(Extent { gaussians: n, views: v, color_len, channels, depth, region })
}
