//! The `.splat` form of web viewers: 32 bytes for each Gaussian, no header, no view-dependent color.

use crate::bytes::Bytes;
use crate::ply::check;
use crate::{Error, Result};
use std::path::Path;
use weaver_geometry::sh;
use weaver_scene::Gaussians;

const RECORD: usize = 32;

/// Reads a `.splat` file: position and linear scale as three floats each, RGBA and the rotation (wxyz, 128 is
/// zero) as four bytes each.
pub fn read_splat(path: impl AsRef<Path>) -> Result<Gaussians> {
    let path = path.as_ref();
    let mut bytes = Bytes::open(path)?;
    let size = bytes.rest().len();
    if size % RECORD != 0 {
        return Err(Error::invalid(path, "length", "a multiple of 32 bytes", size));
    }
    let mut splats = Gaussians::default();
    for _ in 0..size / RECORD {
        splats.means.push(bytes.f32s("a position")?);
        splats.log_scales.push(bytes.f32s("a scale")?.map(|s: f32| s.max(f32::MIN_POSITIVE).ln()));
        let [r, g, b, a] = bytes.take("a color")?;
        splats.sh.extend([r, g, b].map(|c| (f32::from(c) / 255.0 - 0.5) / sh::DC as f32));
        let opacity = f32::from(a) / 255.0;
        splats.opacity_logits.push((opacity / (1.0 - opacity)).ln());
        splats.quats.push(bytes.take("a rotation")?.map(|q: u8| (f32::from(q) - 128.0) / 128.0));
    }
    check(path, &splats)?;
    Ok(splats)
}
