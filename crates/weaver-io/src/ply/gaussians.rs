//! Gaussians as the reference 3DGS implementation stores them.

use super::Table;
use crate::{Error, Result, atomic_write};
use std::path::Path;
use weaver_scene::Gaussians;

/// Reads a 3DGS PLY file, ASCII or binary little-endian. The number of `f_rest_*` properties tells the degree.
///
/// Errors when a property is missing and when a value is not finite (an infinite opacity logit is fine).
/// Chunk-compressed files (`packed_position`) are not read.
pub fn read_ply(path: impl AsRef<Path>) -> Result<Gaussians> {
    let path = path.as_ref();
    let table = Table::read(path)?;
    if table.names.iter().any(|n| n == "packed_position") {
        let found = "a chunk-compressed file (packed_position)";
        return Err(Error::invalid(path, "element vertex", "plain 3DGS properties", found));
    }
    let rest = table.names.iter().filter(|n| n.starts_with("f_rest_")).count();
    let Some(degree) = (0..=4).find(|d| 3 * ((d + 1) * (d + 1) - 1) == rest) else {
        let expected = "0, 9, 24, 45 or 72 properties f_rest_*";
        return Err(Error::invalid(path, "element vertex", expected, rest));
    };
    let columns = |prefix: &str, n: usize| -> Result<Vec<usize>> {
        (0..n).map(|i| table.column(&format!("{prefix}{i}"))).collect()
    };
    let xyz = [table.column("x")?, table.column("y")?, table.column("z")?];
    let opacity = table.column("opacity")?;
    let (scale, rot) = (columns("scale_", 3)?, columns("rot_", 4)?);
    let (dc, rest) = (columns("f_dc_", 3)?, columns("f_rest_", rest)?);
    let per_channel = rest.len() / 3;

    let n = table.rows;
    let mut splats = Gaussians { degree, ..Gaussians::default() };
    splats.sh.reserve_exact(n * 3 * (per_channel + 1));
    for row in 0..n {
        let values = table.row(row);
        splats.means.push(xyz.map(|c| values[c]));
        splats.log_scales.push(std::array::from_fn(|i| values[scale[i]]));
        splats.quats.push(std::array::from_fn(|i| values[rot[i]]));
        splats.opacity_logits.push(values[opacity]);
        splats.sh.extend(dc.iter().map(|&c| values[c]));
        for k in 0..per_channel {
            splats.sh.extend((0..3).map(|channel| values[rest[channel * per_channel + k]]));
        }
    }
    check(path, &splats)?;
    Ok(splats)
}

/// Writes a binary little-endian file with the properties, and in the order, of the reference implementation
/// (normals zero). Errors when the fields' lengths disagree.
pub fn write_ply(path: impl AsRef<Path>, gaussians: &Gaussians) -> Result<()> {
    let path = path.as_ref();
    let (n, k) = (gaussians.len(), gaussians.coefficients());
    let lengths =
        [gaussians.log_scales.len(), gaussians.quats.len(), gaussians.opacity_logits.len(), gaussians.sh.len()];
    if lengths != [n, n, n, n * k * 3] || gaussians.degree > 4 {
        let expected = format!("{n} Gaussians of a degree up to 4 in every field");
        let found = format!("log_scales, quats, opacity_logits, sh of {lengths:?}, degree {}", gaussians.degree);
        return Err(Error::invalid(path, "Gaussians to write", expected, found));
    }
    atomic_write(path, |w| {
        writeln!(w, "ply\nformat binary_little_endian 1.0\nelement vertex {n}")?;
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
    })
}

/// Errors at the first Gaussian with a value that no renderer can use.
pub(crate) fn check(path: &Path, splats: &Gaussians) -> Result<()> {
    let per_row = splats.coefficients() * 3;
    for i in 0..splats.len() {
        let fields: [(&str, &[f32]); 4] = [
            ("position", &splats.means[i]),
            ("scale", &splats.log_scales[i]),
            ("rotation", &splats.quats[i]),
            ("color", &splats.sh[i * per_row..][..per_row]),
        ];
        let bad = fields.iter().find(|(_, values)| !values.iter().all(|x| x.is_finite()));
        if let Some((name, values)) = bad {
            return Err(Error::invalid(path, format!("vertex {i}, {name}"), "finite numbers", format!("{values:?}")));
        }
        if splats.opacity_logits[i].is_nan() {
            return Err(Error::invalid(path, format!("vertex {i}, opacity"), "a number", "NaN"));
        }
    }
    Ok(())
}
