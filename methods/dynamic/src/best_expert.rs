//! The best choice of an expert at each pixel, with the photo at hand: an upper bound on any choice.

use weaver_kernels::Real;

/// The expert with the least squared error at each pixel, the first of equal ones: `[P]`, from pictures `[K, P, 3]` and
/// the photo `[P, 3]`.
///
/// ```
/// let images = [0.0, 0.0, 0.0, 0.4, 0.5, 0.6];
/// assert_eq!(weaver_dynamic::hard_oracle(&images, &[0.5; 3]), [1]);
/// ```
///
/// # Panics
/// Unless the pictures are a whole number of times as long as the photo.
pub fn hard_oracle<T: Real>(images: &[T], photo: &[T]) -> Vec<usize> {
    let whole = photo.len().is_multiple_of(3) && !photo.is_empty() && images.len().is_multiple_of(photo.len());
    assert!(whole, "pictures of the size of a photo with {} numbers, found {}", photo.len(), images.len());
    let error = |image: &[T], pixel: usize| {
        let [r, g, b] = [0, 1, 2].map(|c| image[3 * pixel + c].to_f64() - photo[3 * pixel + c].to_f64());
        r * r + g * g + b * b
    };
    let best = |pixel: usize| {
        let errors: Vec<f64> = images.chunks_exact(photo.len()).map(|image| error(image, pixel)).collect();
        (0..errors.len()).fold(0, |best, k| if errors[k] < errors[best] { k } else { best })
    };
    (0..photo.len() / 3).map(best).collect()
}
