//! Affine maps of colors: the effect of exposure, white balance and a tone curve's slope on a photo.

use weaver_kernels::{Real, dense};

/// An affine map of colors, `rgb' = A rgb + b`: `[A | b]`, `[3, 4]` row by row.
///
/// Two photos of one thing differ by it, nearly, where a camera chose exposure and white balance for each.
///
/// ```
/// use weaver_losses::ColorMap;
///
/// let photo = [0.1, 0.5, 0.7, 0.2, 0.3, 0.9, 0.4, 0.6, 0.8, 0.1, 0.3, 0.2]; // [3, 2, 2]
/// let darker = photo.map(|x| 0.8 * x);
/// let map = ColorMap::between(&darker, &photo, None);
/// let [red, ..] = map.apply([0.08, 0.16, 0.64]);
/// assert!((red - 0.1).abs() < 1e-3);
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ColorMap(pub [f64; 12]);

/// Weight of the squared distance to the identity for each pixel: next to nothing, and enough for images of one color.
const TO_IDENTITY: f64 = 1e-6;

impl ColorMap {
    /// The map that changes nothing.
    pub const IDENTITY: Self = Self([1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0]);

    /// The map that brings the colors of an image nearest to another's, in the mean square over the pixels of a mask
    /// `[H, W]`, or over all. Images are `[3, H, W]`; a pixel that is not finite in both does not count.
    ///
    /// Panics unless sizes agree.
    pub fn between<T: Real>(from: &[T], to: &[T], mask: Option<&[bool]>) -> Self {
        let pixels = from.len() / 3;
        assert!(
            from.len() == 3 * pixels && to.len() == from.len() && mask.is_none_or(|mask| mask.len() == pixels),
            "ColorMap: images of {} and {} numbers",
            from.len(),
            to.len()
        );
        // Sums of products: of (r, g, b, 1) with itself, and with the other image's colors.
        let (mut normal, mut right, mut count) = ([[0.0; 4]; 4], [[0.0; 4]; 3], 0.0);
        for i in (0..pixels).filter(|i| mask.is_none_or(|mask| mask[*i])) {
            let at = |image: &[T]| [0, 1, 2].map(|c| image[c * pixels + i].to_f64());
            let ([r, g, b], to) = (at(from), at(to));
            let x = [r, g, b, 1.0];
            if !x.iter().chain(&to).all(|value| value.is_finite()) {
                continue;
            }
            for j in 0..4 {
                (0..4).for_each(|k| normal[j][k] += x[j] * x[k]);
                (0..3).for_each(|c| right[c][j] += x[j] * to[c]);
            }
            count += 1.0;
        }
        let weight = TO_IDENTITY * f64::max(count, 1.0);
        (0..4).for_each(|j| normal[j][j] += weight);
        (0..3).for_each(|c| right[c][c] += weight);
        let rows = right.map(|right| solved(normal, right));
        Self(std::array::from_fn(|i| rows[i / 4][i % 4]))
    }

    /// The color that this makes of a color.
    pub fn apply(&self, [r, g, b]: [f64; 3]) -> [f64; 3] {
        let m = &self.0;
        [0, 4, 8].map(|row| m[row] * r + m[row + 1] * g + m[row + 2] * b + m[row + 3])
    }
}

/// Solves a system of four, which the weight of the identity makes positive definite.
fn solved(mut matrix: [[f64; 4]; 4], mut right: [f64; 4]) -> [f64; 4] {
    dense::gauss(matrix.as_flattened_mut(), &mut right, |_, _| true);
    right
}
