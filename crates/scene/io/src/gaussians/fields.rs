//! Code shared by the formats of Gaussians: checks of the fields, and numbers as bytes.

use crate::{Error, Result};
use std::path::Path;
use weaver_scene::Gaussians;

/// Checks that the fields of Gaussians to be written have the same length.
pub(crate) fn check_lengths(path: &Path, gaussians: &Gaussians) -> Result<()> {
    if gaussians.lengths_agree() {
        return Ok(());
    }
    let Gaussians { log_scales, quats, opacity_logits, sh, degree, .. } = gaussians;
    let lengths = [log_scales.len(), quats.len(), opacity_logits.len(), sh.len()];
    let expected = format!("{} Gaussians of a degree up to 4 in every field", gaussians.len());
    let found = format!("log_scales, quats, opacity_logits, sh of {lengths:?}, degree {degree}");
    Err(Error::invalid(path, "Gaussians to write", expected, found))
}

/// Checks that every value is one that a renderer can use: finite, but for opacity logits, which may be infinite.
pub(crate) fn check_values(path: &Path, gaussians: &Gaussians) -> Result<()> {
    check_rows(path, gaussians, 0)
}

/// The same for Gaussians that begin at row `first` of the file.
pub(crate) fn check_rows(path: &Path, gaussians: &Gaussians, first: usize) -> Result<()> {
    let per_row = gaussians.coefficients() * 3;
    for i in 0..gaussians.len() {
        let fields: [(&str, &[f32]); 4] = [
            ("position", &gaussians.means[i]),
            ("scale", &gaussians.log_scales[i]),
            ("rotation", &gaussians.quats[i]),
            ("color", &gaussians.sh[i * per_row..][..per_row]),
        ];
        let bad = fields.iter().find(|(_, values)| !values.iter().all(|x| x.is_finite()));
        if let Some((name, values)) = bad {
            return Err(Error::invalid(
                path,
                format!("vertex {}, {name}", first + i),
                "finite numbers",
                format!("{values:?}"),
            ));
        }
        if gaussians.opacity_logits[i].is_nan() {
            return Err(Error::invalid(path, format!("vertex {}, opacity", first + i), "a number", "NaN"));
        }
    }
    Ok(())
}

/// A number as a byte, rounded and clamped.
pub(crate) fn byte(x: f32) -> u8 {
    x.round().clamp(0.0, 255.0) as u8
}

/// The quaternion of unit length, or the identity in place of zeros.
pub(crate) fn unit(q: [f32; 4]) -> [f32; 4] {
    let squares = q.iter().map(|x| x * x).sum::<f32>();
    if squares.is_normal() {
        return q.map(|x| x / squares.sqrt());
    }
    // Squares leave the range of numbers where the components themselves do not.
    let largest = q.iter().fold(0.0_f32, |largest, x| largest.max(x.abs()));
    if largest > 0.0 { unit(q.map(|x| x / largest)) } else { [1.0, 0.0, 0.0, 0.0] }
}
