//! The loss that Gaussians are fitted to photos by: absolute error and structural similarity, with its gradient.

mod band;

use crate::ssim_window::{BORDER, WINDOW, taps};
use band::Band;
use weaver_kernels::{Pool, Real, lanes, parallel};

/// Numbers of a pixel.
const CHANNELS: usize = 3;

/// Rows of pixels of a task. Ten more rows of windows reach into each, whose work is done twice.
const BAND: usize = 64;

/// The photometric loss of a drawn image against a photo, with its gradient in the same pass and without a tape.
///
/// With `w` the weight of the similarity,
///
/// `loss = (1 - w) mean |image - target| + w (1 - SSIM(image, target))`,
///
/// where SSIM is that of [`metrics::ssim`](crate::metrics::ssim): the mean over channels and over all 11x11 Gaussian
/// windows inside the image. An image with fewer than 11 rows or columns has no window; its loss is the mean absolute
/// error, whatever the weight.
///
/// Holds the memory of the loss, one workspace per thread, so that a repeated call allocates nothing. Source: Kerbl et
/// al., 3D Gaussian splatting, 2023, equation 7, with w = 0.2; Wang et al., Image quality assessment, 2004.
///
/// ```
/// use weaver_losses::Photometric;
/// let photo: Vec<f32> = (0..16 * 12 * 3).map(|i| i as f32 / 576.0).collect();
/// let drawn: Vec<f32> = photo.iter().map(|x| x + 0.1).collect();
/// let mut gradient = vec![0.0; drawn.len()];
/// let mut loss = Photometric::new();
/// let value = loss.value_and_gradient(&drawn, &photo, [16, 12], 0.2, &mut gradient);
/// assert!((value.l1 - 0.1).abs() < 1e-6 && value.ssim.is_some_and(|ssim| ssim < 1.0));
/// assert_eq!(loss.value_and_gradient(&photo, &photo, [16, 12], 0.2, &mut gradient).loss, 0.0);
/// ```
#[derive(Clone, Debug)]
pub struct Photometric<T> {
    /// The window's weights, up to the middle one.
    taps: [T; WINDOW / 2 + 1],
    workspaces: Pool,
    /// Sums of each band over its pixels and windows.
    sums: Vec<BandSums>,
}

/// Contribution of an image's band to the loss.
#[derive(Clone, Copy, Debug, Default)]
struct BandSums {
    /// The sum of |image - target|.
    absolute: f64,
    /// The sum of 1 - SSIM over the windows that begin in the band.
    dissimilarity: f64,
}

/// The value of a [`Photometric`] loss, and its two terms.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PhotometricValue {
    /// The mean absolute error.
    pub l1: f64,
    /// The mean structural similarity; none if the image is smaller than a window.
    pub ssim: Option<f64>,
    /// The weighted sum, which the gradient belongs to.
    pub loss: f64,
}

impl<T: Real> Default for Photometric<T> {
    fn default() -> Self {
        Self::new()
    }
}

impl<T: Real> Photometric<T> {
    /// A loss that has no memory yet.
    pub fn new() -> Self {
        let taps = taps();
        Self { taps: std::array::from_fn(|k| T::from_f64(taps[k])), workspaces: Pool::new(), sums: Vec::new() }
    }

    /// The loss of `image` against `target`; writes its derivative with respect to `image` to `gradient`.
    ///
    /// All three are `[H, W, 3]` with the channels of a pixel side by side, `size` is (H, W), and colors are in [0, 1].
    /// The derivative of |x| at 0 is 0. NaN in an image is NaN in the loss. The bits do not depend on the number of
    /// threads.
    ///
    /// # Panics
    ///
    /// Unless the three have that size and are not empty.
    pub fn value_and_gradient(
        &mut self,
        image: &[T],
        target: &[T],
        size: [usize; 2],
        ssim_weight: f64,
        gradient: &mut [T],
    ) -> PhotometricValue {
        let [height, width] = size;
        let line = width * CHANNELS;
        let numbers = height * line;
        assert!(
            numbers > 0 && [image.len(), target.len(), gradient.len()] == [numbers; 3],
            "photometric loss: expected images of {size:?} pixels of three numbers, found {}, {} and {} numbers",
            image.len(),
            target.len(),
            gradient.len()
        );
        if height < WINDOW || width < WINDOW {
            let l1 = absolute(image, target, gradient);
            return PhotometricValue { l1, ssim: None, loss: l1 };
        }
        let windows = ((height - BORDER) * (width - BORDER) * CHANNELS) as f64;
        let slopes = [(1.0 - ssim_weight) / numbers as f64, ssim_weight / windows].map(T::from_f64);
        self.sums.clear();
        self.sums.resize(height.div_ceil(BAND), BandSums::default());
        let (taps, workspaces) = (&self.taps, &self.workspaces);
        parallel::for_chunks2(gradient, BAND * line, &mut self.sums, 1, |band, gradient, sums| {
            let mut workspace = workspaces.buffer(band::workspace_len(line));
            let first = band * BAND;
            let rows = first..(first + BAND).min(height);
            sums[0] = lanes::run(Band { image, target, size, rows, taps, slopes, gradient, workspace: &mut workspace });
        });
        let mean = |of: fn(&BandSums) -> f64, count| self.sums.iter().map(of).sum::<f64>() / count;
        let l1 = mean(|sums| sums.absolute, numbers as f64);
        let dissimilarity = mean(|sums| sums.dissimilarity, windows);
        let loss = (1.0 - ssim_weight) * l1 + ssim_weight * dissimilarity;
        PhotometricValue { l1, ssim: Some(1.0 - dissimilarity), loss }
    }
}

/// The mean absolute error; writes its derivative.
fn absolute<T: Real>(image: &[T], target: &[T], gradient: &mut [T]) -> f64 {
    let slope = T::from_f64(1.0 / image.len() as f64);
    let mut sum = 0.0;
    for ((g, a), b) in gradient.iter_mut().zip(image).zip(target) {
        let difference = *a - *b;
        sum += difference.to_f64().abs();
        *g = match difference.partial_cmp(&T::ZERO) {
            Some(std::cmp::Ordering::Greater) => slope,
            Some(std::cmp::Ordering::Less) => -slope,
            _ => T::ZERO,
        };
    }
    sum / image.len() as f64
}
