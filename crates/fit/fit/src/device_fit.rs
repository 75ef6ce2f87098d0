//! The seam between a fit and a device that keeps the Gaussians.

use std::fmt::Debug;
use std::time::Duration;
use weaver_scene::CameraSlices;
use weaver_splat::{CpuRasterizer, GaussianStatistics, RasterError, RasterSettings, Rasterizer};

/// A rasterizer that a [`Fit`](crate::Fit) draws by.
///
/// `Arc<dyn FitRasterizer>` coerces to [`AnyRasterizer<f32>`](weaver_splat::AnyRasterizer) where only drawing is
/// needed.
pub trait FitRasterizer: Rasterizer<f32> {
    /// Starts a fit on the rasterizer's device; `None` where the host's memory is also the rasterizer's.
    fn device_fit(&self) -> Option<Box<dyn DeviceFit>> {
        None
    }
}

impl FitRasterizer for CpuRasterizer {}

/// A fit of Gaussians to photos in the memory of a device, such as a graphics card: a step copies a photo to it, and
/// only the loss back.
///
/// The loss is `(1 - w) mean |image - photo| + w (1 - SSIM)` and regularizers that are linear in opacities and scales,
/// the step one of Adam with beta 0.9 and 0.999 and an eps of 1e-15 (Kerbl et al., 3D Gaussian splatting, 2023, section
/// 5).
pub trait DeviceFit: Debug + Send {
    /// Takes Gaussians over, in place of those before; statistics begin anew.
    ///
    /// # Errors
    ///
    /// More Gaussians than there is room for.
    fn load(&mut self, gaussians: &Fitted<[&[f32]; 3]>) -> Result<(), RasterError>;

    /// One step toward a photo.
    ///
    /// # Errors
    ///
    /// Arguments that do not fit together, more than can be drawn, or a device that fails.
    fn step(&mut self, step: &PhotoStep<'_>) -> Result<PhotoLoss, RasterError>;

    /// Time of each pass since the last call, by the device's clock; nothing where that is not measured.
    fn pass_times(&mut self) -> Vec<(&'static str, Duration)> {
        Vec::new()
    }

    /// Brings the Gaussians back, as many as were loaded. Adds the statistics since they were brought back last.
    ///
    /// # Errors
    ///
    /// A device that fails.
    fn store(
        &mut self,
        gaussians: Fitted<[&mut [f32]; 3]>,
        statistics: &mut [GaussianStatistics<f32>],
    ) -> Result<(), RasterError>;
}

/// The parameters of N Gaussians in stored form, each with Adam's first and second moment of it.
#[derive(Clone, Debug)]
pub struct Fitted<S> {
    /// `[N, 3]`
    pub means: S,
    /// wxyz of any length, `[N, 4]`
    pub quats: S,
    /// Natural logarithms of the standard deviations, `[N, 3]`
    pub log_scales: S,
    /// Opacities before the sigmoid, `[N]`
    pub logits: S,
    /// Spherical harmonics, `[N, K, 3]`
    pub sh: S,
    /// Their degree.
    pub degree: usize,
}

/// A step toward a photo.
#[derive(Clone, Copy, Debug)]
pub struct PhotoStep<'a> {
    /// The photo's camera, one view, and the background.
    pub camera: CameraSlices<'a, f32>,
    /// Settings of drawing.
    pub settings: &'a RasterSettings,
    /// sRGB, `[H, W, 3]`.
    pub rgb: &'a [u8],
    /// Mask of the pixels that count, `[H, W]`; `None` if all do.
    pub mask: Option<&'a [bool]>,
    /// The weight w of 1 - SSIM.
    pub ssim_weight: f64,
    /// Gradients that regularizers add for each opacity and for each scale.
    pub regularizer: [f32; 2],
    /// Steps done with these moments, this one included.
    pub step: u64,
    /// Learning rates.
    pub rates: FittedRates,
    /// True if by-products of the backward pass are summed.
    pub statistics: bool,
}

/// Learning rates of Adam.
#[derive(Clone, Copy, Debug)]
pub struct FittedRates {
    /// Of the means.
    pub means: f32,
    /// Of the quaternions.
    pub quats: f32,
    /// Of the logarithms of the scales.
    pub scales: f32,
    /// Of the logits.
    pub opacities: f32,
    /// Of the harmonics of degree 0.
    pub sh: f32,
    /// Of the other harmonics.
    pub sh_rest: f32,
}

/// Losses of a step before it moved anything.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PhotoLoss {
    /// The loss, without regularizers.
    pub loss: f64,
    /// The mean squared difference of the image, brought into [0, 1], and the photo.
    pub mse: f64,
    /// Splats over pixels that they add to; 0 where they are not counted.
    pub pairs: u64,
}
