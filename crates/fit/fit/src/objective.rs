//! The loss between a drawn view and its photo.

use std::fmt::Debug;
use weaver_losses::Photometric;

/// A loss between a drawn view and its photo.
///
/// ```
/// use weaver_fit::Objective;
///
/// #[derive(Debug)]
/// struct MeanSquare;
///
/// impl Objective for MeanSquare {
///     fn compare(&mut self, image: &[f32], photo: &[f32], _: [usize; 2], gradient: &mut [f32]) -> f64 {
///         let n = image.len() as f32;
///         let mut sum = 0.0;
///         for ((g, a), b) in gradient.iter_mut().zip(image).zip(photo) {
///             *g = 2.0 * (a - b) / n;
///             sum += f64::from((a - b) * (a - b));
///         }
///         sum / f64::from(n)
///     }
/// }
/// ```
///
/// [`Fit::set_objective`](crate::Fit::set_objective) takes it.
pub trait Objective: Debug + Send {
    /// The loss, and its gradient with respect to `image`, which is written over `gradient`; all are `[height, width,
    /// 3]`, `photo` in [0, 1], `image` as drawn.
    fn compare(&mut self, image: &[f32], photo: &[f32], size: [usize; 2], gradient: &mut [f32]) -> f64;
}

/// `(1 - w) mean |image - photo| + w (1 - SSIM)`, the loss of 3DGS (Kerbl et al., 2023, equation 7).
#[derive(Debug)]
pub struct L1Ssim {
    /// The weight w.
    pub ssim_weight: f64,
    photometric: Photometric<f32>,
}

impl L1Ssim {
    /// The loss with this weight of 1 - SSIM.
    pub fn new(ssim_weight: f64) -> Self {
        Self { ssim_weight, photometric: Photometric::new() }
    }
}

impl Objective for L1Ssim {
    fn compare(&mut self, image: &[f32], photo: &[f32], size: [usize; 2], gradient: &mut [f32]) -> f64 {
        self.photometric.value_and_gradient(image, photo, size, self.ssim_weight, gradient).loss
    }
}
