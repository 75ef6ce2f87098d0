//! High-frequency energy of every pixel, without a tape.

use crate::detail_energy::detail_energy_into;
use crate::filter::Wavelet;
use crate::luma::luma_into;
use crate::transform::{Border, analyze};
use weaver_autograd::{Pool, Real};
use weaver_kernels::resample::Resample;

/// Computes the high-frequency energy of images of one size without a tape, as a target for training or a guide for
/// allocation. On a tape, use [`energy`](crate::energy()).
///
/// ```
/// use weaver_autograd::Pool;
/// use weaver_wavelet::{EnergyMap, Wavelet};
/// let map = EnergyMap::<f32>::new(Wavelet::Db2, [4, 6]);
/// let mut energy = [0.0; 24];
/// map.compute(&[0.5; 3 * 24], &Pool::new(), &mut energy);
/// assert!(energy.iter().all(|e| (e - 1e-4).abs() < 1e-5), "a flat image has next to none");
/// ```
#[derive(Clone, Debug)]
pub struct EnergyMap<T> {
    wavelet: Wavelet,
    size: [usize; 2],
    resize: Resample<T>,
}

impl<T: Real> EnergyMap<T> {
    /// For images of `size` (H, W).
    pub fn new(wavelet: Wavelet, size: [usize; 2]) -> Self {
        let resize = Resample::bilinear(size.map(|n| wavelet.output_len(n)), size, false);
        Self { wavelet, size, resize }
    }

    /// The energy `[N, H, W]` of images `[N, 3, H, W]` with values in [0, 1].
    ///
    /// sqrt(b1^2 + b2^2 + b3^2 + 1e-8) of the detail bands of the luma, resized to the image (bilinear, corners not
    /// aligned). Panics unless both have N images of the size. Source: `wavelet_high_freq_map` of the official
    /// SplatWeaver code.
    pub fn compute(&self, images: &[T], pool: &Pool, energy: &mut [T]) {
        let pixels = self.size[0] * self.size[1];
        assert!(
            images.len() == 3 * energy.len() && energy.len().is_multiple_of(pixels),
            "energy map of images of {:?}: {} numbers for {} pixels",
            self.size,
            images.len(),
            energy.len()
        );
        let count = energy.len() / pixels;
        let band = self.resize.input_size().iter().product();
        let mut bands = pool.buffer(count * 4 * band);
        let mut coefficients = pool.buffer(count * band);
        luma_into(images, pixels, energy);
        analyze(self.wavelet, Border::Symmetric, energy, self.size, &mut bands);
        detail_energy_into(&bands, band, &mut coefficients);
        self.resize.forward(&coefficients, energy);
    }
}
