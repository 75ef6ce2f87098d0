//! Point clouds.

use super::Table;
use crate::files::file::read_bytes;
use crate::gaussians::fields::byte;
use crate::{Error, Result, atomic_write};
use std::path::Path;
use weaver_scene::PointCloud;

/// Reads a point cloud from a PLY file, ASCII or binary little-endian.
///
/// The properties are `x`, `y`, `z` and, optionally, `red`, `green`, `blue` (0 to 255); without colors, points are
/// white.
///
/// # Errors
/// When a property is missing or a position is not finite.
pub fn read_points(path: impl AsRef<Path>) -> Result<PointCloud> {
    let path = path.as_ref();
    let table = Table::read(path, &read_bytes(path)?)?;
    let columns = |names: [&str; 3]| -> Result<Vec<usize>> { names.iter().map(|name| table.column(name)).collect() };
    let xyz = columns(["x", "y", "z"])?;
    let rgb = table.names.iter().any(|n| n == "red").then(|| columns(["red", "green", "blue"])).transpose()?;
    let mut points = PointCloud::default();
    for row in 0..table.rows {
        let values = table.row(row);
        let position = std::array::from_fn(|i| values[xyz[i]]);
        if !position.iter().all(|x: &f32| x.is_finite()) {
            let found = format!("{position:?}");
            return Err(Error::invalid(path, format!("vertex {row}, position"), "finite numbers", found));
        }
        points.positions.push(position);
        points.colors.push(rgb.as_ref().map_or([255; 3], |c| std::array::from_fn(|i| byte(values[c[i]]))));
    }
    Ok(points)
}

/// Writes colored points as a binary little-endian PLY file (x y z red green blue), which mesh viewers open.
///
/// # Errors
/// When there are not as many colors as positions, or the file cannot be written.
pub fn write_points(path: impl AsRef<Path>, points: &PointCloud) -> Result<()> {
    let path = path.as_ref();
    let PointCloud { positions, colors } = points;
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
