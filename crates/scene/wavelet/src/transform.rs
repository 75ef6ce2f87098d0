//! The two kernels behind analysis and synthesis: a strided correlation with both filters along both axes, and its
//! transpose.

use crate::filter::{MAX_TAPS, Wavelet};
use weaver_kernels::{Real, parallel};

/// The values that the filters meet beyond the image.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Border {
    /// The image mirrored, edge sample repeated (half-sample symmetry).
    Symmetric,
    /// Zeros.
    Zero,
}

impl Border {
    /// The sample that stands at position `i` of a signal of `n` samples.
    fn source(self, i: isize, n: usize) -> Option<usize> {
        if (0..n as isize).contains(&i) {
            return Some(i as usize);
        }
        match self {
            Self::Zero => None,
            Self::Symmetric => {
                let i = i.rem_euclid(2 * n as isize) as usize;
                Some(if i < n { i } else { 2 * n - 1 - i })
            }
        }
    }
}

/// A filter bank at work on images of one size.
struct Bank<T> {
    border: Border,
    taps: usize,
    low: [T; MAX_TAPS],
    high: [T; MAX_TAPS],
    height: usize,
    width: usize,
    out_height: usize,
    out_width: usize,
}

impl<T: Real> Bank<T> {
    fn new(wavelet: Wavelet, border: Border, [height, width]: [usize; 2]) -> Self {
        let taps = wavelet.taps();
        let tap = |j, f: &dyn Fn(usize) -> f64| if j < taps { T::from_f64(f(j)) } else { T::ZERO };
        Self {
            border,
            taps,
            low: std::array::from_fn(|j| tap(j, &|j| wavelet.low()[j])),
            high: std::array::from_fn(|j| tap(j, &|j| wavelet.high(j))),
            height,
            width,
            out_height: wavelet.output_len(height),
            out_width: wavelet.output_len(width),
        }
    }

    /// Coefficients of one sub-band of one image.
    fn band_len(&self) -> usize {
        self.out_height * self.out_width
    }

    /// The samples that the taps of coefficient `k` meet.
    fn sources(&self, k: usize, n: usize) -> [Option<usize>; MAX_TAPS] {
        let first = 2 * k as isize + 2 - self.taps as isize;
        std::array::from_fn(|j| if j < self.taps { self.border.source(first + j as isize, n) } else { None })
    }

    fn analyze(&self, image: &[T], bands: &mut [T]) {
        let size = self.band_len();
        for ky in 0..self.out_height {
            let rows = self.sources(ky, self.height);
            for kx in 0..self.out_width {
                let columns = self.sources(kx, self.width);
                let mut sums = [T::ZERO; 4];
                for (jx, column) in columns.iter().enumerate() {
                    let Some(column) = column else { continue };
                    let (mut low, mut high) = (T::ZERO, T::ZERO);
                    for (jy, row) in rows.iter().enumerate() {
                        let Some(row) = row else { continue };
                        let x = image[row * self.width + column];
                        low += self.low[jy] * x;
                        high += self.high[jy] * x;
                    }
                    sums[0] += self.low[jx] * low;
                    sums[1] += self.low[jx] * high;
                    sums[2] += self.high[jx] * low;
                    sums[3] += self.high[jx] * high;
                }
                for (band, sum) in sums.into_iter().enumerate() {
                    bands[band * size + ky * self.out_width + kx] = sum;
                }
            }
        }
    }

    /// Adds the transpose of [`analyze`](Self::analyze).
    fn add_transposed(&self, bands: &[T], image: &mut [T]) {
        let size = self.band_len();
        for ky in 0..self.out_height {
            let rows = self.sources(ky, self.height);
            for kx in 0..self.out_width {
                let columns = self.sources(kx, self.width);
                let coefficient: [T; 4] = std::array::from_fn(|b| bands[b * size + ky * self.out_width + kx]);
                for (jx, column) in columns.iter().enumerate() {
                    let Some(column) = column else { continue };
                    let low = self.low[jx] * coefficient[0] + self.high[jx] * coefficient[2];
                    let high = self.low[jx] * coefficient[1] + self.high[jx] * coefficient[3];
                    for (jy, row) in rows.iter().enumerate() {
                        let Some(row) = row else { continue };
                        image[row * self.width + column] += self.low[jy] * low + self.high[jy] * high;
                    }
                }
            }
        }
    }
}

/// Writes the four sub-bands of `images` `[N, H, W]` to `bands` `[N, 4, h, w]`.
///
/// Coefficient k of a row meets the samples 2k + 2 - L to 2k + 1. Bands: (x low, y low), (x low, y high),
/// (x high, y low), (x high, y high).
pub fn analyze<T: Real>(wavelet: Wavelet, border: Border, images: &[T], size: [usize; 2], bands: &mut [T]) {
    let bank = Bank::new(wavelet, border, size);
    let pixels = size[0] * size[1];
    parallel::for_chunks(bands, 4 * bank.band_len(), |n, bands| {
        bank.analyze(&images[n * pixels..(n + 1) * pixels], bands);
    });
}

/// Adds the transpose of [`analyze`], applied to `bands` `[N, 4, h, w]`, to `images` `[N, H, W]`.
pub fn add_transposed<T: Real>(wavelet: Wavelet, border: Border, bands: &[T], size: [usize; 2], images: &mut [T]) {
    let bank = Bank::new(wavelet, border, size);
    let coefficients = 4 * bank.band_len();
    parallel::for_chunks(images, size[0] * size[1], |n, image| {
        bank.add_transposed(&bands[n * coefficients..(n + 1) * coefficients], image);
    });
}
