//! Numbers of a Gaussian in stored form, and their meaning.

use weaver_geometry::sh::DC;

/// The opacity of a logit, `1 / (1 + exp(-logit))`.
pub fn opacity(logit: f32) -> f32 {
    1.0 / (1.0 + (-logit).exp())
}

/// The logit of an opacity, `ln(opacity / (1 - opacity))`; infinite at 0 and 1.
///
/// ```
/// use weaver_scene::forms::{opacity, opacity_logit};
/// assert!((opacity(opacity_logit(0.3)) - 0.3).abs() < 1e-6);
/// ```
pub fn opacity_logit(opacity: f32) -> f32 {
    (opacity / (1.0 - opacity)).ln()
}

/// The harmonic of degree 0 of a color that is the same from everywhere, `(color - 1/2) / Y_0`; colors are sRGB in `[0,
/// 1]`.
pub fn harmonic(color: f32) -> f32 {
    (color - 0.5) / DC as f32
}

/// The color of a harmonic of degree 0 alone, `1/2 + Y_0 harmonic`.
///
/// ```
/// use weaver_scene::forms::{color, harmonic};
/// assert!((color(harmonic(0.8)) - 0.8).abs() < 1e-6);
/// ```
pub fn color(harmonic: f32) -> f32 {
    0.5 + DC as f32 * harmonic
}

/// Maps colors: `rgb' = A rgb + b` for harmonics `[N, K, 3]`, with K = `coefficients` for each Gaussian and `map` `[A |
/// b]`, `[3, 4]` row by row.
///
/// A maps all coefficients, since colors are linear in them; b moves only degree 0, which also takes up the 1/2 that a
/// [`color`] adds.
///
/// ```
/// use weaver_scene::forms::{color, harmonic, map_colors};
/// let mut sh = [0.2, 0.4, 0.6].map(harmonic); // one Gaussian of degree 0
/// let (brighter, redder) = ([1.5, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.1]);
/// map_colors(&mut sh, 1, &[brighter, redder, [0.0, 0.0, 1.0, 0.0]].concat().try_into().unwrap());
/// let mapped = sh.map(color);
/// assert!(mapped.iter().zip([0.3, 0.5, 0.6]).all(|(a, b)| (a - b).abs() < 1e-6));
/// ```
pub fn map_colors(sh: &mut [f32], coefficients: usize, map: &[f32; 12]) {
    for coefficients in sh.chunks_exact_mut(3 * coefficients) {
        for (k, rgb) in coefficients.chunks_exact_mut(3).enumerate() {
            let old = [rgb[0], rgb[1], rgb[2]];
            for (new, row) in rgb.iter_mut().zip(map.chunks_exact(4)) {
                *new = row[0] * old[0] + row[1] * old[1] + row[2] * old[2];
                // A color is 1/2 where all coefficients are 0.
                if k == 0 {
                    *new += (0.5 * (row[0] + row[1] + row[2] - 1.0) + row[3]) / DC as f32;
                }
            }
        }
    }
}
