//! Agreement of images with photos.

use serde::{Deserialize, Serialize};
use weaver_losses::metrics::{self, PerceptualDistance};

/// Smallest side of an image that SSIM is computed for: the side of its window.
const LEAST_SIDE: usize = 11;

/// Quality of an image beside a photo, or the mean of images beside photos.
#[derive(Clone, Copy, Debug, Default, Deserialize, PartialEq, Serialize)]
pub struct Quality {
    /// Peak signal-to-noise ratio, dB, of values clamped to [0, 1] and not rounded.
    pub psnr: f64,
    /// The same after the affine map of colors that brings the image nearest to the photo, so that the photo's exposure
    /// and white balance are not held against the scene; `None` in figures of versions before this one.
    #[serde(default)]
    pub psnr_aligned: Option<f64>,
    /// Structural similarity; `None` for images smaller than its window.
    pub ssim: Option<f64>,
    /// Perceptual distance; `None` without weights, and for images too small for the network.
    pub lpips: Option<f64>,
}

impl Quality {
    /// The mean over images; `None` of none.
    pub fn mean(all: &[Self]) -> Option<Self> {
        let mean = |of: &dyn Fn(&Self) -> Option<f64>| {
            all.iter().map(of).collect::<Option<Vec<f64>>>().map(|v| v.iter().sum::<f64>() / v.len() as f64)
        };
        (!all.is_empty()).then(|| Self {
            psnr: all.iter().map(|q| q.psnr).sum::<f64>() / all.len() as f64,
            psnr_aligned: mean(&|q| q.psnr_aligned),
            ssim: mean(&|q| q.ssim),
            lpips: mean(&|q| q.lpips),
        })
    }
}

/// Compares images with photos; with a network for LPIPS also by that.
#[derive(Debug, Default)]
pub struct Judge {
    lpips: Option<Box<dyn PerceptualDistance<f32>>>,
}

impl Judge {
    /// With or without LPIPS.
    pub fn new(lpips: Option<impl PerceptualDistance<f32> + 'static>) -> Self {
        Self { lpips: lpips.map(|network| Box::new(network) as _) }
    }

    /// The PSNR of an image `[H, W, 3]` beside the photo's bytes, dB, over the pixels of a mask `[H, W]` or over all:
    /// the part of [`compare_inside`](Self::compare_inside) that takes no time. NaN where no pixel counts.
    ///
    /// ```
    /// use weaver_fit::Judge;
    /// let (image, photo) = ([0.1, 0.1, 0.1, 0.9, 0.9, 0.9], [0, 0, 0, 0, 0, 0]);
    /// assert!((Judge::psnr(&image, &photo, Some(&[true, false])) - 20.0).abs() < 1e-5);
    /// ```
    pub fn psnr(image: &[f32], photo: &[u8], mask: Option<&[bool]>) -> f64 {
        let counts = |pixel: usize| mask.is_none_or(|mask| mask[pixel]);
        let pixels = image.chunks_exact(3).zip(photo.chunks_exact(3)).enumerate().filter(|(at, _)| counts(*at));
        let (mut sum, mut count) = (0.0, 0.0);
        for (_, (drawn, wanted)) in pixels {
            let off = |c: usize| f64::from(drawn[c].clamp(0.0, 1.0)) - f64::from(wanted[c]) / 255.0;
            sum += (0..3).map(|c| off(c) * off(c)).sum::<f64>();
            count += 3.0;
        }
        -10.0 * (sum / count).log10()
    }

    /// Judges an image `[H, W, 3]` by the photo's bytes; `size` is height, width.
    pub fn compare(&self, image: &[f32], photo: &[u8], size: [usize; 2]) -> Quality {
        self.compare_inside(image, photo, size, None)
    }

    /// Judges an image as [`compare`](Self::compare) does, by the pixels that count by a mask `[H, W]`; NaN where none
    /// does.
    pub fn compare_inside(&self, image: &[f32], photo: &[u8], size: [usize; 2], mask: Option<&[bool]>) -> Quality {
        let [height, width] = size;
        let target: Vec<f32> = photo.iter().map(|b| f32::from(*b) / 255.0).collect();
        let planes = |pixels: &[f32]| -> Vec<f32> {
            (0..3).flat_map(|c| pixels.iter().skip(c).step_by(3).map(|x| x.clamp(0.0, 1.0))).collect()
        };
        let network = self.lpips.as_deref().filter(|network| height.min(width) >= network.least_side());
        let large = height.min(width) >= LEAST_SIDE;
        let (drawn, wanted) = (planes(image), planes(&target));
        let psnr_aligned = metrics::psnr_aligned(&drawn, &wanted, mask);
        match mask {
            Some(inside) => Quality {
                psnr: metrics::psnr_masked(&drawn, &wanted, inside).unwrap_or(f64::NAN),
                psnr_aligned,
                ssim: large.then(|| metrics::ssim_masked(&drawn, &wanted, [3, height, width], inside)).flatten(),
                lpips: network.and_then(|network| metrics::lpips_masked(network, &drawn, &wanted, size, inside)),
            },
            None => Quality {
                psnr: metrics::psnr(image, &target),
                psnr_aligned,
                ssim: large.then(|| metrics::ssim(&drawn, &wanted, [3, height, width])),
                lpips: network.map(|network| network.between(&drawn, &wanted, size)),
            },
        }
    }
}
