//! Losses between render and photo.

use super::{Method, mean_square};
use weaver_losses::Photometric;

/// The least side of a photo, pixels: the size of the windows of SSIM.
const LEAST_SIDE: usize = 11;

/// Loss between render and photo while a camera is aligned.
#[derive(Clone, Copy, Debug, Eq, PartialEq)]
pub enum AlignLoss {
    /// The mean square of differences, by which the published methods align.
    MeanSquare,
    /// Mean absolute differences and structure, `0.8 L1 + 0.2 (1 - SSIM)`: the loss by which scenes are fitted.
    Photometric,
    /// Structure alone, `1 - SSIM`; of images with fewer than 11 rows or columns the mean absolute difference.
    Similarity,
}

impl AlignLoss {
    /// The default loss of a method: for published methods as published, for ours the loss that finds most cameras.
    pub fn of(method: Method) -> Self {
        if method == Method::Own { Self::Photometric } else { Self::MeanSquare }
    }

    /// The smallest side of a photo at which the loss is defined, pixels.
    pub fn least_side(self) -> usize {
        if self == Self::Similarity { LEAST_SIDE } else { 1 }
    }

    /// The loss as [`align`](super::align()) takes it.
    pub fn function(self) -> impl FnMut(&[f32], &[f32], [usize; 2], &mut [f32]) -> f64 {
        let mut photometric = Photometric::new();
        move |image: &[f32], photo: &[f32], size: [usize; 2], gradient: &mut [f32]| {
            let structure = match self {
                Self::MeanSquare => return mean_square(image, photo, size, gradient),
                Self::Photometric => 0.2,
                Self::Similarity => 1.0,
            };
            photometric.value_and_gradient(image, photo, size, structure, gradient).loss
        }
    }
}
