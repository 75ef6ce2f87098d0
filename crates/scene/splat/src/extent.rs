//! The sizes of a call, and whether its arguments fit together.

use crate::error::RasterError;
use crate::gradients::{Cotangents, Gradients};
use crate::rasterizer::Images;
use crate::settings::RasterSettings;
use crate::tiles::Region;
use weaver_geometry::sh;
use weaver_kernels::Real;
use weaver_scene::{CameraSlices, Color, GaussianSlices, Groups, Model};

/// The sizes of a call, for those who implement a [`Rasterizer`](crate::Rasterizer): checked once, then relied on.
///
/// ```
/// use weaver_scene::{CameraSlices, Color, GaussianSlices, Model};
/// use weaver_splat::{Extent, RasterSettings};
/// let gaussians = GaussianSlices {
///     means: &[0.0_f32; 6],
///     quats: &[1.0; 8],
///     scales: &[0.5; 6],
///     opacities: &[0.8; 2],
///     color: Color::Plain(&[0.5; 6]),
///     features: None,
///     groups: None,
/// };
/// let intrinsics = [10.0, 10.0, 1.5, 1.5];
/// let cameras = CameraSlices { viewmats: &[0.0; 12], intrinsics: &intrinsics, background: &[0.0; 3], width: 3, height: 2, model: Model::Pinhole };
/// let extent = Extent::of(&gaussians, &cameras, &RasterSettings::default(), false)?;
/// assert_eq!((extent.gaussians, extent.views, extent.pixels()), (2, 1, 6));
/// # Ok::<(), weaver_splat::RasterError>(())
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub struct Extent {
    /// N.
    pub gaussians: usize,
    /// V.
    pub views: usize,
    /// Numbers per Gaussian's color.
    pub color_len: usize,
    /// K, pictures of each view; 1 for Gaussians without groups.
    pub groups: usize,
    /// C.
    pub channels: usize,
    /// True if depth was requested.
    pub depth: bool,
    /// Region of each view that is drawn.
    pub region: Region,
}

/// `length == expected`, or an error that names the argument.
pub(crate) fn expect_len(name: &str, length: usize, expected: usize) -> Result<(), RasterError> {
    if length == expected {
        return Ok(());
    }
    Err(RasterError::Arguments(format!("{name} has {length} numbers, expected {expected}")))
}

/// Number of groups.
fn checked(groups: Groups<'_>, n: usize) -> Result<usize, RasterError> {
    let Groups { of, count } = groups;
    expect_len("groups", of.len(), n)?;
    if count == 0 {
        return Err(RasterError::Arguments("Gaussians in 0 groups, expected at least 1".into()));
    }
    if let Some((row, group)) = of.iter().enumerate().find(|(_, group)| **group as usize >= count) {
        return Err(RasterError::Arguments(format!(
            "Gaussian {row} is in group {group}, the last of {count} is {}",
            count - 1
        )));
    }
    Ok(count)
}

impl Extent {
    /// The sizes of a call of pinholes, if everything in it fits together; `depth` says whether depth is requested.
    ///
    /// # Errors
    ///
    /// Cameras that are not pinholes, lengths that do not fit, a degree above 4, an image without pixels, a background
    /// that is not finite, a region beyond the image, more Gaussians than a call may have.
    pub fn of<T: Real>(
        gaussians: &GaussianSlices<'_, T>,
        cameras: &CameraSlices<'_, T>,
        settings: &RasterSettings,
        depth: bool,
    ) -> Result<Self, RasterError> {
        if cameras.model != Model::Pinhole {
            let message = "this rasterizer draws pinhole cameras only, found a lens; the CPU draws through lenses";
            return Err(RasterError::Unsupported(message.into()));
        }
        Self::through_any_lens(gaussians, cameras, settings, depth)
    }

    /// As [`of`](Self::of), for cameras of any model.
    pub(crate) fn through_any_lens<T: Real>(
        gaussians: &GaussianSlices<'_, T>,
        cameras: &CameraSlices<'_, T>,
        settings: &RasterSettings,
        depth: bool,
    ) -> Result<Self, RasterError> {
        let (n, v) = (gaussians.opacities.len(), cameras.views());
        if let Color::Sh { degree, .. } = gaussians.color
            && degree > sh::MAX_DEGREE
        {
            return Err(RasterError::Arguments(format!(
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
        let groups = gaussians.groups.map_or(Ok(1), |groups| checked(groups, n))?;
        expect_len("intrinsics", cameras.intrinsics.len(), 4 * v)?;
        if cameras.viewmats.len() != 16 * v {
            expect_len("viewmats", cameras.viewmats.len(), 12 * v)?;
        }
        if cameras.background.len() != 3 {
            expect_len("background", cameras.background.len(), 3 * v)?;
        }
        if !cameras.background.iter().all(|x| x.is_finite()) {
            return Err(RasterError::Arguments("the background holds a number that is not finite".into()));
        }
        let (width, height) = (cameras.width, cameras.height);
        if width == 0 || height == 0 || width > 1 << 20 || height > 1 << 20 {
            return Err(RasterError::Arguments(format!("an image of {width} x {height} pixels")));
        }
        let region = settings.region.unwrap_or(Region::whole(width, height));
        if !region.is_within(width, height) {
            let Region { x, y, width: w, height: h } = region;
            return Err(RasterError::Arguments(format!(
                "a region of {w} x {h} pixels at ({x}, {y}) is empty or reaches beyond the image of {width} x {height} pixels"
            )));
        }
        if v.checked_mul(n).is_none_or(|all| all >= u32::MAX as usize) {
            return Err(RasterError::TooMany(format!("{v} views of {n} Gaussians are too many for one call")));
        }
        Ok(Self { gaussians: n, views: v, color_len, groups, channels, depth, region })
    }

    /// Pixels of all images together.
    pub fn pixels(&self) -> usize {
        self.views * self.groups * self.region.pixels()
    }

    /// True if the images have these sizes.
    ///
    /// # Errors
    ///
    /// Names the image that has another length.
    pub fn check_images<T>(&self, images: &Images<'_, T>) -> Result<(), RasterError> {
        let pixels = self.pixels();
        expect_len("image", images.image.len(), if self.color_len > 0 { 3 * pixels } else { 0 })?;
        expect_len("alpha", images.alpha.len(), pixels)?;
        images.depth.as_ref().map_or(Ok(()), |depth| expect_len("depth", depth.len(), pixels))?;
        let features = images.features.as_ref().map_or(0, |features| features.len());
        expect_len("image of the features", features, pixels * self.channels)
    }

    /// True if the inputs and outputs of a backward pass have these sizes.
    ///
    /// # Errors
    ///
    /// Names an argument of another length.
    pub fn check_backward<T: Real>(
        &self,
        cameras: &CameraSlices<'_, T>,
        cotangents: &Cotangents<'_, T>,
        gradients: &Gradients<'_, T>,
    ) -> Result<(), RasterError> {
        let (n, v) = (self.gaussians, self.views);
        let pixels = self.pixels();
        if cameras.model != Model::Pinhole && gradients.intrinsics.is_some() {
            return Err(RasterError::Unsupported("a lens has no gradient of the intrinsics".into()));
        }
        let inputs = [
            ("cotangent of the image", cotangents.image, if self.color_len > 0 { 3 * pixels } else { 0 }),
            ("cotangent of alpha", cotangents.alpha, pixels),
            ("cotangent of the depth", cotangents.depth, if self.depth { pixels } else { 0 }),
            ("cotangent of the features", cotangents.features, self.channels * pixels),
        ];
        for (name, values, expected) in inputs {
            values.map_or(Ok(()), |values| expect_len(name, values.len(), expected))?;
        }
        let outputs = [
            ("gradient of the means", &gradients.means, 3 * n),
            ("gradient of the quats", &gradients.quats, 4 * n),
            ("gradient of the scales", &gradients.scales, 3 * n),
            ("gradient of the opacities", &gradients.opacities, n),
            ("gradient of the colors", &gradients.colors, self.color_len * n),
            ("gradient of the features", &gradients.features, self.channels * n),
            ("gradient of the viewmats", &gradients.viewmats, cameras.viewmats.len()),
            ("gradient of the intrinsics", &gradients.intrinsics, 4 * v),
            ("gradient of the background", &gradients.background, cameras.background.len()),
        ];
        gradients.statistics.as_ref().map_or(Ok(()), |all| match all.len() == n {
            true => Ok(()),
            false => Err(RasterError::Arguments(format!("statistics of {} Gaussians, expected {n}", all.len()))),
        })?;
        for (name, target, expected) in outputs {
            target.as_ref().map_or(Ok(()), |target| expect_len(name, target.values.len(), expected))?;
        }
        Ok(())
    }
}
