//! Single numbers of a Gaussian in stored form, and what they stand for.

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

/// The harmonic of degree 0 of a color that is the same from everywhere, `(color - 1/2) / Y_0`; colors are sRGB in `[0, 1]`.
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
