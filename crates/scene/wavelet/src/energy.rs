//! High-frequency energy of every pixel, on the tape.

use crate::{Wavelet, analysis, detail_energy, luma};
use weaver_autograd::{Real, Var};

/// The high-frequency energy of every pixel of images with values in [0, 1].
///
/// It is `sqrt(b1^2 + b2^2 + b3^2 + 1e-8)` of the detail bands of the luma, resized to the image (bilinear, corners not
/// aligned). Images `[N, 3, H, W]` give `[N, H, W]`. Differentiable; where the energy is a constant,
/// [`EnergyMap`](crate::EnergyMap) computes it without a tape.
#[track_caller]
pub fn energy<T: Real>(images: Var<'_, T>, wavelet: Wavelet) -> Var<'_, T> {
    let coefficients = detail_energy(analysis(luma(images), wavelet));
    let [count, h, w] = [0, 1, 2].map(|axis| coefficients.shape()[axis]);
    let [height, width] = [images.shape()[2], images.shape()[3]];
    coefficients.reshape([count, 1, h, w]).bilinear(height, width, false).reshape([count, height, width])
}
