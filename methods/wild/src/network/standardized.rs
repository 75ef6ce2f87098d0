//! Photos without the contrast and the brightness of their moment.

use weaver_autograd::Real;

/// Lower bound of a channel's standard deviation in the division, so that a photo of one color is all zero.
pub const LEAST_DEVIATION: f64 = 0.02;

/// Photos whose channels have mean 0 and standard deviation 1: (I - mean) / max(deviation, 0.02).
///
/// `photos` are V planes of three channels, `[V, 3, H, W]`; mean and deviation are over the pixels `inside`
/// `[V, H, W]`, or over all of them. Pixels outside are transformed alike; a photo without pixels inside has mean and
/// deviation 0.
///
/// # Panics
/// If the planes are not three for each view of the mask.
///
/// ```
/// let photo = [0.2, 0.4, 0.9, 0.5, 0.5, 0.5, 0.0, 1.0, 0.3];
/// let found: Vec<f64> = weaver_wild::standardized(&photo, Some(&[true, true, false]), 3);
/// let expected = [-1.0, 1.0, 6.0, 0.0, 0.0, 0.0, -1.0, 1.0, -0.4];
/// assert!(found.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-12), "{found:?}");
/// ```
pub fn standardized<T: Real>(photos: &[T], inside: Option<&[bool]>, pixels: usize) -> Vec<T> {
    assert!(pixels > 0 && photos.len().is_multiple_of(3 * pixels), "standardized: planes [V, 3, {pixels}]");
    assert!(inside.is_none_or(|inside| 3 * inside.len() == photos.len()), "standardized: a mask of the photos' size");
    let mut all = Vec::with_capacity(photos.len());
    for (i, plane) in photos.chunks_exact(pixels).enumerate() {
        let mask = inside.map(|inside| &inside[i / 3 * pixels..][..pixels]);
        let counted = || (0..pixels).filter(|at| mask.is_none_or(|mask| mask[*at])).map(|at| plane[at].to_f64());
        let count = counted().count().max(1) as f64;
        let mean = counted().sum::<f64>() / count;
        let variance = counted().map(|x| (x - mean).powi(2)).sum::<f64>() / count;
        let scale = 1.0 / variance.sqrt().max(LEAST_DEVIATION);
        all.extend(plane.iter().map(|x| T::from_f64((x.to_f64() - mean) * scale)));
    }
    all
}
