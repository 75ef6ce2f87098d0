//! Pixels inside triangles.

use weaver_geometry::glam::{DMat2, DVec2, DVec3};

/// Calls a function for every pixel of an image `[width, height]` whose center a triangle covers, edges included, with
/// the parts of the corners there.
pub fn inside([a, b, c]: [DVec2; 3], [width, height]: [usize; 2], mut then: impl FnMut(usize, usize, [f64; 3])) {
    let double = (b - a).perp_dot(c - a);
    if double == 0.0 || !double.is_finite() {
        return;
    }
    let range = |of: fn(DVec2) -> f64, size: usize| {
        let [a, b, c] = [a, b, c].map(of);
        let low = (a.min(b).min(c) - 0.5).ceil().max(0.0) as usize;
        let high = (a.max(b).max(c) + 0.5).floor().clamp(0.0, size as f64) as usize;
        low..high
    };
    for y in range(|p| p.y, height) {
        for x in range(|p| p.x, width) {
            let p = DVec2::new(x as f64 + 0.5, y as f64 + 0.5);
            let parts = [(b - p).perp_dot(c - p), (c - p).perp_dot(a - p), (a - p).perp_dot(b - p)];
            let parts = parts.map(|part| part / double);
            if parts.iter().all(|part| *part >= -1e-9) {
                then(x, y, parts);
            }
        }
    }
}

/// The steps in space along a pixel's two sides; none for a triangle without area.
pub fn spans(at: [DVec2; 3], corners: [DVec3; 3]) -> Option<[DVec3; 2]> {
    let flat = DMat2::from_cols(at[1] - at[0], at[2] - at[0]);
    let inverse = (flat.determinant() != 0.0).then(|| flat.inverse()).filter(|m| m.is_finite())?;
    let step = |along: DVec2| (corners[1] - corners[0]) * along.x + (corners[2] - corners[0]) * along.y;
    Some([step(inverse.x_axis), step(inverse.y_axis)])
}
