//! Comparison of a drawn view with its photo.

use crate::exposure::{self, Exposure};
use weaver_kernels::{parallel, simd};
use weaver_losses::Photometric;

/// A photo as a view is compared with it.
pub(crate) struct Compared<'a> {
    /// Colors `[H, W, 3]`.
    pub rgb: &'a [u8],
    /// Mask of the pixels that count, if not all do.
    pub mask: Option<&'a [bool]>,
    /// Height and width.
    pub size: [usize; 2],
}

/// Images of a step.
#[derive(Debug, Default)]
pub(crate) struct Buffers {
    pub target: Vec<f32>,
    pub image: Vec<f32>,
    pub corrected: Vec<f32>,
    pub alpha: Vec<f32>,
    pub depth: Vec<f32>,
    pub gradient: Vec<f32>,
    /// Sums over parts of an image.
    squares: Vec<f32>,
    photometric: Photometric<f32>,
}

impl Buffers {
    pub fn resize(&mut self, pixels: usize) {
        let Self { target, image, corrected, alpha, depth, gradient, .. } = self;
        [target, image, corrected, gradient].into_iter().for_each(|b| b.resize(3 * pixels, 0.0));
        alpha.resize(pixels, 0.0);
        depth.resize(pixels, 0.0);
    }

    /// The loss `(1 - w) mean |image - photo| + w (1 - SSIM)` of 3DGS (Kerbl et al., 2023, equation 7), the mean
    /// squared difference, and the gradient of the loss with respect to the correction; the buffers then hold its
    /// gradient with respect to the image.
    pub fn compare(
        &mut self,
        photo: &Compared<'_>,
        exposure: Option<&Exposure>,
        ssim_weight: f64,
    ) -> (f64, f64, Option<[f32; exposure::NUMBERS]>) {
        const GRAIN: usize = 3 << 12;
        parallel::for_chunks(&mut self.target, GRAIN, |chunk, target| {
            let bytes = &photo.rgb[chunk * GRAIN..];
            target.iter_mut().zip(bytes).for_each(|(t, b)| *t = f32::from(*b) * (1.0 / 255.0));
        });
        let corrected = match exposure {
            Some(exposure) => {
                exposure.apply(&self.image, &mut self.corrected);
                &mut self.corrected
            }
            None => &mut self.image,
        };
        if let Some(mask) = photo.mask {
            // Masked pixels are taken to be as drawn: no difference, and windows of SSIM see nothing of the photo
            // there.
            let pixels = corrected.chunks_exact_mut(3).zip(self.target.chunks_exact_mut(3));
            let masked = pixels.zip(mask).filter(|(_, m)| !**m);
            for ((drawn, target), _) in masked {
                drawn.iter_mut().for_each(|x| *x = x.clamp(0.0, 1.0));
                target.copy_from_slice(drawn);
            }
        }
        let value =
            self.photometric.value_and_gradient(corrected, &self.target, photo.size, ssim_weight, &mut self.gradient);
        let mse = mean_square(corrected, &self.target, &mut self.squares);
        if let Some(mask) = photo.mask {
            let pixels = self.gradient.chunks_exact_mut(3).zip(mask);
            pixels.filter(|(_, m)| !**m).for_each(|(g, _)| g.fill(0.0));
        }
        let of_exposure = exposure.map(|exposure| exposure.pull_back(&self.image, &mut self.gradient));
        (value.loss, mse, of_exposure)
    }
}

/// The mean squared difference of an image, brought into [0, 1], and a photo.
fn mean_square(image: &[f32], photo: &[f32], sums: &mut Vec<f32>) -> f64 {
    /// Numbers of a part; sums that run side by side in it; parts of a task.
    const PART: usize = 1 << 12;
    const LANES: usize = 16;
    const GRAIN: usize = 8;
    sums.resize(image.len().div_ceil(PART), 0.0);
    parallel::for_chunks(sums, GRAIN, |task, sums| {
        let parts = image.chunks(PART).zip(photo.chunks(PART)).skip(task * GRAIN);
        for (sum, (image, photo)) in sums.iter_mut().zip(parts) {
            *sum = simd::dispatch(
                #[inline(always)]
                || {
                    let mut lanes = [0.0; LANES];
                    for (image, photo) in image.chunks(LANES).zip(photo.chunks(LANES)) {
                        for ((lane, a), b) in lanes.iter_mut().zip(image).zip(photo) {
                            *lane += (a.clamp(0.0, 1.0) - b) * (a.clamp(0.0, 1.0) - b);
                        }
                    }
                    lanes.iter().sum()
                },
            );
        }
    });
    sums.iter().map(|sum| f64::from(*sum)).sum::<f64>() / image.len() as f64
}
