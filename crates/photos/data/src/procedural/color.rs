//! Colors by their common names.

use weaver_geometry::glam::DVec3;

/// Hue (turns), saturation and value to RGB.
pub(super) fn color(hue: f64, saturation: f64, value: f64) -> DVec3 {
    let channel = |shift: f64| {
        let h = ((hue + shift).rem_euclid(1.0) * 6.0 - 3.0).abs() - 1.0;
        value * (1.0 + saturation * (h.clamp(0.0, 1.0) - 1.0))
    };
    DVec3::new(channel(0.0), channel(2.0 / 3.0), channel(1.0 / 3.0))
}
