//! The local density of Gaussians in the image.

use weaver_autograd::{Buffer, Pool, Real};

/// The smallest count: one Gaussian in 25 pixels.
const LEAST: f64 = 0.04;

/// Averages windows of `2 radius + 1` along an axis of a row-major array with `length` entries `stride` apart, over the
/// part of the window that lies inside.
fn box_filter(from: &[f64], to: &mut [f64], length: usize, stride: usize, radius: usize) {
    for (at, out) in to.iter_mut().enumerate() {
        let i = at / stride % length;
        let (low, high) = (i.saturating_sub(radius), (i + radius).min(length - 1));
        let first = at - i * stride;
        let sum: f64 = (low..=high).map(|k| from[first + k * stride]).sum();
        *out = sum / (high - low + 1) as f64;
    }
}

/// The local number of Gaussians per pixel `[P]`, at least 0.04.
///
/// The count of each pixel (`expert` `[P]`) is averaged over 5 x 5 and then over 3 x 3 pixels of its view; each average
/// runs over the pixels inside the image.
pub fn local_count<T: Real>(expert: &[u8], height: usize, width: usize, pool: &Pool) -> Buffer<T> {
    let mut count = pool.buffer::<f64>(expert.len());
    let mut row_means = pool.buffer::<f64>(expert.len());
    count.iter_mut().zip(expert).for_each(|(c, &e)| *c = f64::from(e));
    for radius in [2, 1] {
        // A window inside the image is a rectangle, so its average is the average of its rows' averages.
        for view in 0..expert.len() / (height * width).max(1) {
            let pixels = view * height * width..(view + 1) * height * width;
            box_filter(&count[pixels.clone()], &mut row_means[pixels.clone()], width, 1, radius);
            box_filter(&row_means[pixels.clone()], &mut count[pixels], height, width, radius);
        }
    }
    let mut result = pool.buffer::<T>(expert.len());
    result.iter_mut().zip(count.iter()).for_each(|(r, &c)| *r = T::from_f64(c.max(LEAST)));
    result
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The average over a window by its definition, pixel by pixel.
    fn by_definition(count: &[f64], h: usize, w: usize, radius: isize) -> Vec<f64> {
        let mut out = Vec::new();
        for at in 0..count.len() {
            let (view, y, x) = (at / (h * w), (at / w % h) as isize, (at % w) as isize);
            let (mut sum, mut inside) = (0.0, 0.0);
            for dy in -radius..=radius {
                for dx in -radius..=radius {
                    let (y, x) = (y + dy, x + dx);
                    if (0..h as isize).contains(&y) && (0..w as isize).contains(&x) {
                        sum += count[view * h * w + y as usize * w + x as usize];
                        inside += 1.0;
                    }
                }
            }
            out.push(sum / inside);
        }
        out
    }

    #[test]
    fn box_filters_stay_inside_their_view() {
        for (h, w) in [(1, 1), (1, 7), (4, 3), (9, 6)] {
            let expert: Vec<u8> = (0..2 * h * w).map(|i| u8::from(i * 7 % 11 == 3) + u8::from(i % 5 == 0)).collect();
            let count: Vec<f64> = expert.iter().map(|&e| f64::from(e)).collect();
            let expected = by_definition(&by_definition(&count, h, w, 2), h, w, 1);
            let found = local_count::<f64>(&expert, h, w, &Pool::new());
            for (found, expected) in found.iter().zip(expected) {
                assert!((found - expected.max(LEAST)).abs() < 1e-12, "{h} x {w}: {found} against {expected}");
            }
        }
    }
}
