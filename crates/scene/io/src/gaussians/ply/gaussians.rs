//! Gaussians as the reference 3DGS implementation stores them.

use super::table::first_lines;
use super::{Table, compressed};
use crate::gaussians::fields::check_values;
use crate::gaussians::scene_file::{Drawing, SceneFile};
use crate::{Error, Result};
use std::io::{self, Write};
use std::path::Path;
use weaver_geometry::sh;
use weaver_scene::{Gaussians, forms};

/// Reads a 3DGS PLY file, ASCII or binary little-endian, or a compressed one.
///
/// The number of `f_rest_*` properties tells the degree of the spherical harmonics. Positions and scales are required: a
/// file without scales is a point cloud, for [`read_points`](crate::gaussians::ply::read_points). Other missing properties are filled
/// as viewers do it: without a rotation it is the identity, without an opacity Gaussians are opaque, and without harmonics
/// (`f_dc_*`) the color is that of `red`, `green`, `blue` (0 to 255), or else middle gray.
///
/// # Errors
/// When a required property or a part of a property is missing, or a value is not finite (opacity logits may be infinite).
pub(crate) fn decode(path: &Path, data: &[u8]) -> Result<SceneFile> {
    let table = Table::read(path, data)?;
    let has = |name: &str| table.names.iter().any(|n| n == name);
    if has("packed_position") {
        let gaussians = compressed::decode(path, data)?;
        return Ok(SceneFile { gaussians, drawing: Drawing::antialiased(table.antialiased) });
    }
    if !has("scale_0") {
        let found = "a point cloud: no property scale_0";
        return Err(Error::invalid(path, "element vertex", "Gaussians", found));
    }
    let rest = table.names.iter().filter(|n| n.starts_with("f_rest_")).count();
    let Some(degree) = (0..=sh::MAX_DEGREE).find(|d| 3 * (sh::coefficients(*d) - 1) == rest) else {
        let expected = "0, 9, 24, 45 or 72 properties f_rest_*";
        return Err(Error::invalid(path, "element vertex", expected, rest));
    };
    let columns = |prefix: &str, n: usize| -> Result<Vec<usize>> {
        (0..n).map(|i| table.column(&format!("{prefix}{i}"))).collect()
    };
    let optional = |first: &str, columns: &dyn Fn() -> Result<Vec<usize>>| -> Result<Option<Vec<usize>>> {
        has(first).then(columns).transpose()
    };
    let xyz = [table.column("x")?, table.column("y")?, table.column("z")?];
    let scale = columns("scale_", 3)?;
    let rotation = optional("rot_0", &|| columns("rot_", 4))?;
    let opacity = optional("opacity", &|| Ok(vec![table.column("opacity")?]))?;
    // Harmonics beyond the constant one mean nothing without it.
    let dc = if rest > 0 || has("f_dc_0") { Some(columns("f_dc_", 3)?) } else { None };
    let rgb = optional("red", &|| ["red", "green", "blue"].map(|name| table.column(name)).into_iter().collect())?;
    let rest = columns("f_rest_", rest)?;
    let per_channel = rest.len() / 3;

    let n = table.rows;
    let mut gaussians = Gaussians { degree, ..Gaussians::default() };
    gaussians.sh.reserve_exact(n * 3 * (per_channel + 1));
    for row in 0..n {
        let values = table.row(row);
        gaussians.means.push(xyz.map(|c| values[c]));
        gaussians.log_scales.push(std::array::from_fn(|i| values[scale[i]]));
        let identity = [1.0, 0.0, 0.0, 0.0];
        gaussians.quats.push(rotation.as_ref().map_or(identity, |c| std::array::from_fn(|i| values[c[i]])));
        gaussians.opacity_logits.push(opacity.as_ref().map_or(f32::INFINITY, |c| values[c[0]]));
        match (&dc, &rgb) {
            (Some(dc), _) => gaussians.sh.extend(dc.iter().map(|&c| values[c])),
            (None, Some(rgb)) => gaussians.sh.extend(rgb.iter().map(|&c| forms::harmonic(values[c] / 255.0))),
            (None, None) => gaussians.sh.extend([0.0; 3]),
        }
        for k in 0..per_channel {
            gaussians.sh.extend((0..3).map(|channel| values[rest[channel * per_channel + k]]));
        }
    }
    check_values(path, &gaussians)?;
    Ok(SceneFile { gaussians, drawing: Drawing::antialiased(table.antialiased) })
}

/// Writes a 3DGS PLY file, binary little-endian, with the properties of the reference implementation in its order; normals
/// are zero.
pub(crate) fn encode(path: &Path, gaussians: &Gaussians, drawing: Drawing, w: &mut dyn Write) -> Result<()> {
    written(gaussians, drawing, w).map_err(Error::io(path))
}

fn written(gaussians: &Gaussians, drawing: Drawing, w: &mut dyn Write) -> io::Result<()> {
    let (n, k) = (gaussians.len(), gaussians.coefficients());
    writeln!(w, "{}element vertex {n}", first_lines(drawing))?;
    for name in ["x", "y", "z", "nx", "ny", "nz"] {
        writeln!(w, "property float {name}")?;
    }
    for (prefix, count) in [("f_dc_", 3), ("f_rest_", 3 * (k - 1))] {
        (0..count).try_for_each(|i| writeln!(w, "property float {prefix}{i}"))?;
    }
    writeln!(w, "property float opacity")?;
    for (prefix, count) in [("scale_", 3), ("rot_", 4)] {
        (0..count).try_for_each(|i| writeln!(w, "property float {prefix}{i}"))?;
    }
    writeln!(w, "end_header")?;
    for i in 0..n {
        let sh = &gaussians.sh[i * k * 3..][..k * 3];
        let rest = (0..3).flat_map(|channel| (1..k).map(move |c| sh[c * 3 + channel]));
        let row = (gaussians.means[i].into_iter())
            .chain([0.0; 3])
            .chain(sh[..3].iter().copied())
            .chain(rest)
            .chain([gaussians.opacity_logits[i]])
            .chain(gaussians.log_scales[i])
            .chain(gaussians.quats[i]);
        for value in row {
            w.write_all(&value.to_le_bytes())?;
        }
    }
    Ok(())
}
