//! Image metrics without a tape: plain functions of slices, computed in `f64` unless stated otherwise.

use crate::ColorMap;
use crate::ssim_window::{Covariance, WINDOW, Windows};
use std::fmt::Debug;
use weaver_kernels::Real;
use weaver_kernels::order::quantile;

/// The peak signal-to-noise ratio of two images in dB.
///
/// It is -10 log10 of the mean squared difference, after clamping both images to [0, 1] without rounding; infinite for
/// equal images. Panics unless the images have the same size and are not empty.
///
/// ```
/// assert_eq!(weaver_losses::metrics::psnr(&[0.5_f32, 1.5], &[0.4, 1.0]).round(), 23.0);
/// ```
pub fn psnr<T: Real>(a: &[T], b: &[T]) -> f64 {
    assert!(a.len() == b.len() && !a.is_empty(), "psnr: images of {} and {} numbers", a.len(), b.len());
    let sum: f64 = a.iter().zip(b).map(|(a, b)| squared_difference(*a, *b)).sum();
    decibels(sum / a.len() as f64)
}

/// The [`psnr`] over the pixels of a mask, or `None` if the mask is empty.
///
/// Images are `[C, H, W]`, the mask is `[H, W]`.
pub fn psnr_masked<T: Real>(a: &[T], b: &[T], mask: &[bool]) -> Option<f64> {
    assert!(
        a.len() == b.len() && !mask.is_empty() && a.len().is_multiple_of(mask.len()),
        "psnr_masked: images of {} and {} numbers, a mask of {}",
        a.len(),
        b.len(),
        mask.len()
    );
    let (mut sum, mut count) = (0.0, 0);
    for (i, (a, b)) in a.iter().zip(b).enumerate() {
        if mask[i % mask.len()] {
            sum += squared_difference(*a, *b);
            count += 1;
        }
    }
    (count > 0).then(|| decibels(sum / f64::from(count)))
}

/// The [`psnr`] after the affine map of colors that brings the first image nearest to the second, over the pixels of a
/// mask or over all; `None` if the mask is empty.
///
/// Exposure and white balance of the second, a photo, are then not held against the first. Images are `[3, H, W]`, the
/// mask is `[H, W]`. The map is fitted to the first image as it is drawn, clamped to [0, 1]; its result is clamped as
/// by [`psnr`].
pub fn psnr_aligned<T: Real>(a: &[T], b: &[T], mask: Option<&[bool]>) -> Option<f64> {
    let pixels = a.len() / 3;
    let clamped: Vec<f64> = a.iter().map(|x| x.to_f64().clamp(0.0, 1.0)).collect();
    let target: Vec<f64> = b.iter().map(|x| x.to_f64()).collect();
    let map = ColorMap::between(&clamped, &target, mask);
    let mut aligned = clamped;
    for i in 0..pixels {
        let color = map.apply([0, 1, 2].map(|c| aligned[c * pixels + i]));
        (0..3).for_each(|c| aligned[c * pixels + i] = color[c]);
    }
    match mask {
        Some(mask) => psnr_masked(&aligned, &target, mask),
        None => Some(psnr(&aligned, &target)),
    }
}

/// The structural similarity (SSIM) of two images `[C, H, W]` in [0, 1], as scikit-image computes it.
///
/// It is the mean over all channels and over all 11x11 Gaussian windows (sigma 1.5) inside the image, with sample
/// covariances (a factor of 121/120). `size` is (C, H, W). Panics unless both images have that size and are at least 11
/// x 11.
pub fn ssim<T: Real>(a: &[T], b: &[T], size: [usize; 3]) -> f64 {
    let [channels, height, width] = size;
    let pixels = height * width;
    assert!(
        a.len() == channels * pixels && b.len() == a.len() && channels > 0 && height >= WINDOW && width >= WINDOW,
        "ssim: expected two images of {size:?} of at least {WINDOW} x {WINDOW}, found {} and {} numbers",
        a.len(),
        b.len()
    );
    let windows = Windows::<f64>::new([height, width], Covariance::Sample);
    let mut workspace = vec![0.0; windows.workspace_len()];
    let widen = |plane: &[T]| plane.iter().map(|x| x.to_f64()).collect::<Vec<_>>();
    let planes = a.chunks(pixels).zip(b.chunks(pixels));
    planes.map(|(a, b)| windows.similarity(&widen(a), &widen(b), None, &mut workspace)).sum::<f64>() / channels as f64
}

/// The structural similarity over the pixels of a mask, or `None` if the mask is empty.
///
/// As [`ssim`], where the mask `[H, W]` is false both are taken to be white, and only windows that hold pixels of the
/// mask count.
pub fn ssim_masked<T: Real>(a: &[T], b: &[T], size: [usize; 3], mask: &[bool]) -> Option<f64> {
    let [_, height, width] = size;
    assert_eq!(mask.len(), height * width, "ssim_masked: a mask of the images' size");
    let seen = |(y, x): (usize, usize)| (y..y + WINDOW).any(|y| mask[y * width + x..][..WINDOW].contains(&true));
    let windows = (0..=height - WINDOW).flat_map(|y| (0..=width - WINDOW).map(move |x| (y, x)));
    let (all, counted) = (windows.clone().count(), windows.filter(|at| seen(*at)).count());
    let apart = 1.0 - ssim(&inside(a, mask), &inside(b, mask), size);
    (counted > 0).then(|| 1.0 - apart * all as f64 / counted as f64)
}

/// The perceptual distance over the pixels of a mask, or `None` if the mask is empty.
///
/// As [`PerceptualDistance::between`], where the mask `[H, W]` is false both are taken to be white, and the distance is
/// per pixel of the mask.
pub fn lpips_masked<T: Real>(
    network: &dyn PerceptualDistance<T>,
    a: &[T],
    b: &[T],
    size: [usize; 2],
    mask: &[bool],
) -> Option<f64> {
    let counted = mask.iter().filter(|inside| **inside).count();
    let distance = || network.between(&inside(a, mask), &inside(b, mask), size);
    (counted > 0).then(|| distance() * mask.len() as f64 / counted as f64)
}

/// An image `[C, H, W]` where a mask `[H, W]` is true, and white elsewhere.
fn inside<T: Real>(image: &[T], mask: &[bool]) -> Vec<T> {
    image.iter().enumerate().map(|(i, x)| if mask[i % mask.len()] { *x } else { T::ONE }).collect()
}

/// A perceptual distance of images, such as LPIPS, whatever computes it.
pub trait PerceptualDistance<T: Real>: Debug + Send + Sync {
    /// Smallest side of the images that can be compared.
    fn least_side(&self) -> usize;

    /// The distance of two images `[3, H, W]` in [0, 1], in the network's own precision.
    ///
    /// `size` is (H, W). Panics unless both images have three planes of that size.
    fn between(&self, a: &[T], b: &[T], size: [usize; 2]) -> f64;
}

/// The mask of a view's energetic pixels: those whose high-frequency energy is at or above its 0.75 quantile.
///
/// It holds the quarter of the pixels with most detail, and all pixels of a view without contrast; with `among`, of
/// these pixels alone.
pub fn energetic_mask<T: Real>(energy: &[T], among: Option<&[bool]>) -> Vec<bool> {
    let counts = |i: usize| among.is_none_or(|among| among[i]);
    let mut counted: Vec<T> = energy.iter().enumerate().filter(|(i, _)| counts(*i)).map(|(_, e)| *e).collect();
    if counted.is_empty() {
        return vec![false; energy.len()];
    }
    let threshold = quantile(&mut counted, 0.75);
    energy.iter().enumerate().map(|(i, e)| counts(i) && *e >= threshold).collect()
}

fn squared_difference<T: Real>(a: T, b: T) -> f64 {
    // NaN stays NaN: a broken render must not pass for a black one.
    let difference = a.to_f64().clamp(0.0, 1.0) - b.to_f64().clamp(0.0, 1.0);
    difference * difference
}

fn decibels(mse: f64) -> f64 {
    -10.0 * mse.log10()
}
