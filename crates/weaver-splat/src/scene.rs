//! From where and by which settings is drawn, and whether the arguments of a call fit together.

use crate::each::each;
use crate::matrix::{self, Mat33, Vec3};
use std::fmt;
use weaver_geometry::sh;
use weaver_kernels::Real;
use weaver_kernels::lanes::Lanes;
use weaver_scene::{CameraSlices, Color, GaussianSlices};

/// One camera, in numbers or in lanes that all hold the same.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Viewpoint<X> {
    /// A.
    pub axes: Mat33<X>,
    /// t.
    pub shift: Vec3<X>,
    /// -A^-1 t.
    pub center: Vec3<X>,
    /// fx, fy.
    pub focal: [X; 2],
    /// cx, cy.
    pub principal: [X; 2],
    /// Lower limits of x/z and y/z in the Jacobian.
    pub low: [X; 2],
    /// Upper limits.
    pub high: [X; 2],
}

impl<T: Real> Viewpoint<T> {
    /// View `v` of the cameras, ready to project with.
    pub fn of(cameras: &CameraSlices<'_, T>, v: usize) -> Self {
        let m = &cameras.viewmats[v * cameras.matrix_len()..];
        let k = &cameras.intrinsics[4 * v..];
        let axes: Mat33<T> = std::array::from_fn(|i| std::array::from_fn(|j| m[4 * i + j]));
        let shift: Vec3<T> = std::array::from_fn(|i| m[4 * i + 3]);
        let center = matrix::apply(&matrix::inverse(&axes), shift.map(|x| -x.to_f64())).map(T::from_f64);
        let (focal, principal) = ([k[0], k[1]], [k[2], k[3]]);
        let size = [T::from_usize(cameras.width), T::from_usize(cameras.height)];
        // The frustum, widened by 30 % of half its size, bounds x/z and y/z in the Jacobian.
        let margin = T::from_f64(0.15);
        let low = std::array::from_fn(|i| -(principal[i] + margin * size[i]) / focal[i]);
        let high = std::array::from_fn(|i| (size[i] - principal[i] + margin * size[i]) / focal[i]);
        Self { axes, shift, center, focal, principal, low, high }
    }

    /// The same in all lanes.
    #[inline(always)]
    pub fn in_lanes<V: Lanes<Scalar = T>>(&self) -> Viewpoint<V> {
        let Self { axes, shift, center, focal, principal, low, high } = *self;
        Viewpoint {
            axes: each!(3, |i| each!(3, |j| V::splat(axes[i][j]))),
            shift: each!(3, |i| V::splat(shift[i])),
            center: each!(3, |i| V::splat(center[i])),
            focal: each!(2, |i| V::splat(focal[i])),
            principal: each!(2, |i| V::splat(principal[i])),
            low: each!(2, |i| V::splat(low[i])),
            high: each!(2, |i| V::splat(high[i])),
        }
    }
}

/// The rules of drawing that can be chosen.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RasterSettings {
    /// Gaussians whose mean is nearer than this along the optical axis are not drawn, world units.
    pub near: f64,
    /// Nor those farther than this.
    pub far: f64,
    /// Variance added to both image axes, pixels squared: a low-pass filter.
    pub eps2d: f64,
    /// Largest alpha of one Gaussian at one pixel.
    pub alpha_max: f64,
    /// Whether the opacity is lowered by `sqrt(det S / det(S + eps2d I))`, which undoes the gain in size by the blur.
    pub antialiased: bool,
    /// Gaussians with three standard deviations of their longest image axis below this many pixels are not drawn; 0
    /// draws all.
    pub radius_clip: f64,
    /// Side of the square tiles. A choice of speed: images do not depend on it.
    pub tile: TileSide,
}

/// Side of a tile, which has one list of splats.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum TileSide {
    /// 16 pixels.
    Sixteen,
    /// 32 pixels.
    ThirtyTwo,
    /// 64 pixels.
    SixtyFour,
}

impl TileSide {
    /// In pixels.
    pub fn pixels(self) -> usize {
        match self {
            TileSide::Sixteen => 16,
            TileSide::ThirtyTwo => 32,
            TileSide::SixtyFour => 64,
        }
    }
}

impl Default for RasterSettings {
    fn default() -> Self {
        Self {
            near: 0.01,
            far: 1e10,
            eps2d: 0.3,
            alpha_max: 0.99,
            antialiased: false,
            radius_clip: 0.0,
            tile: TileSide::Sixteen,
        }
    }
}

impl RasterSettings {
    /// The settings of the published SplatWeaver: gsplat 1.4.0 with near plane 1e-10 and alpha up to 0.999.
    pub fn published() -> Self {
        Self { near: 1e-10, alpha_max: 0.999, ..Self::default() }
    }
}

/// Alpha below which a Gaussian leaves a pixel alone.
pub(crate) const ALPHA_MIN: f64 = 1.0 / 255.0;
/// A pixel ends before the Gaussian that would bring its transmittance to this or less.
pub(crate) const TRANSMITTANCE_END: f64 = 1e-4;
/// Smallest antialiasing ratio of determinants; no gradient flows through it where it holds.
pub(crate) const RATIO_FLOOR: f64 = 0.005 * 0.005;

/// Arguments that do not fit together.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct RasterError {
    message: String,
}

impl RasterError {
    pub(crate) fn new(message: impl Into<String>) -> Self {
        Self { message: message.into() }
    }
}

impl fmt::Display for RasterError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "rasterize: {}", self.message)
    }
}

impl std::error::Error for RasterError {}

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
    /// W.
    pub width: usize,
    /// H.
    pub height: usize,
    /// Pixels per tile side.
    pub side: usize,
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
    if v.checked_mul(n).is_none_or(|all| all >= u32::MAX as usize) {
        return Err(RasterError::new(format!("{v} views of {n} Gaussians are too many for one call")));
    }
    Ok(Extent { gaussians: n, views: v, color_len, channels, depth, width, height, side: settings.tile.pixels() })
}
