//! Gaussians as the reference 3DGS implementation stores them.

use super::Table;
use crate::{Error, Result, atomic_write};
use std::path::Path;

/// Gaussians in stored form: log scales, logit opacities, quaternions not necessarily of unit length.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct SplatPly {
    /// Centers, `[N, 3]`.
    pub means: Vec<[f32; 3]>,
    /// Natural logarithms of the standard deviations along the axes, `[N, 3]`.
    pub log_scales: Vec<[f32; 3]>,
    /// Rotations, wxyz, `[N, 4]`.
    pub quats: Vec<[f32; 4]>,
    /// Opacities before the sigmoid, `[N]`.
    pub opacity_logits: Vec<f32>,
    /// Spherical-harmonics coefficients, `[N, K, 3]` with `K = (degree + 1)^2`.
    pub sh: Vec<f32>,
    /// Degree of the spherical harmonics, 0 to 4.
    pub degree: usize,
}

impl SplatPly {
    /// Number of Gaussians.
    pub fn len(&self) -> usize {
        self.means.len()
    }

    /// Whether there are no Gaussians.
    pub fn is_empty(&self) -> bool {
        self.means.is_empty()
    }

    /// Coefficients per channel, `(degree + 1)^2`.
    pub fn coefficients(&self) -> usize {
        (self.degree + 1).pow(2)
    }

    /// Reads a 3DGS PLY file, ASCII or binary little-endian. The number of `f_rest_*` properties tells the degree.
    ///
    /// Errors when a property is missing and when a value is not finite (an infinite opacity logit is fine).
    /// Chunk-compressed files (`packed_position`) are not read.
    pub fn read(path: impl AsRef<Path>) -> Result<Self> {
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
        let mut splats = Self { degree, ..Self::default() };
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
    pub fn write(&self, path: impl AsRef<Path>) -> Result<()> {
        let path = path.as_ref();
        let (n, k) = (self.len(), self.coefficients());
        let lengths = [self.log_scales.len(), self.quats.len(), self.opacity_logits.len(), self.sh.len()];
        if lengths != [n, n, n, n * k * 3] || self.degree > 4 {
            let expected = format!("{n} Gaussians of a degree up to 4 in every field");
            let found = format!("log_scales, quats, opacity_logits, sh of {lengths:?}, degree {}", self.degree);
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
                let sh = &self.sh[i * k * 3..][..k * 3];
                let rest = (0..3).flat_map(|channel| (1..k).map(move |c| sh[c * 3 + channel]));
                let row = (self.means[i].into_iter())
                    .chain([0.0; 3])
                    .chain(sh[..3].iter().copied())
                    .chain(rest)
                    .chain([self.opacity_logits[i]])
                    .chain(self.log_scales[i])
                    .chain(self.quats[i]);
                for value in row {
                    w.write_all(&value.to_le_bytes())?;
                }
            }
            Ok(())
        })
    }
}

/// Errors at the first Gaussian with a value that no renderer can use.
pub(crate) fn check(path: &Path, splats: &SplatPly) -> Result<()> {
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
