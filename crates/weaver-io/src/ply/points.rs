//! Plain point clouds.

use crate::{Error, Result, atomic_write};
use std::path::Path;

/// Writes colored points as a binary little-endian PLY file (x y z red green blue), which mesh viewers open.
/// Errors when there are not as many colors as positions.
pub fn write_points(path: impl AsRef<Path>, positions: &[[f32; 3]], colors: &[[u8; 3]]) -> Result<()> {
    let path = path.as_ref();
    if positions.len() != colors.len() {
        let expected = format!("{} colors", positions.len());
        return Err(Error::invalid(path, "points to write", expected, colors.len()));
    }
    atomic_write(path, |w| {
        writeln!(w, "ply\nformat binary_little_endian 1.0\nelement vertex {}", positions.len())?;
        for name in ["x", "y", "z"] {
            writeln!(w, "property float {name}")?;
        }
        for name in ["red", "green", "blue"] {
            writeln!(w, "property uchar {name}")?;
        }
        writeln!(w, "end_header")?;
        for (position, color) in positions.iter().zip(colors) {
            for x in position {
                w.write_all(&x.to_le_bytes())?;
            }
            w.write_all(color)?;
        }
        Ok(())
    })
}
