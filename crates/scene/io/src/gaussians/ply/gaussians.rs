//! Gaussians as the reference 3DGS implementation stores them.

use super::compressed;
use super::header::{Element, Format, Header, first_lines};
use super::table::ascii;
use crate::files::content::Content;
use crate::gaussians::blocks::Blocks;
use crate::gaussians::fields::{check_rows, check_values};
use crate::gaussians::scene_file::{Drawing, OpenScene};
use crate::{Error, Result};
use std::borrow::Cow;
use std::io::{self, Write};
use std::ops::Range;
use std::path::{Path, PathBuf};
use weaver_geometry::sh;
use weaver_scene::{Gaussians, forms};

/// Opens a 3DGS PLY file, ASCII or binary little-endian, or a compressed one. Rows of a binary file are read on demand.
///
/// The number of `f_rest_*` properties gives the degree of the spherical harmonics. Positions and scales are required:
/// a file without scales is a point cloud, for [`read_points`](crate::gaussians::ply::read_points). Other missing
/// properties are filled as viewers do it: without a rotation it is the identity, without an opacity Gaussians are
/// opaque, and without harmonics (`f_dc_*`) the color comes from `red`, `green`, `blue` (0 to 255), or else is middle
/// gray.
///
/// # Errors
/// When a required property or a part of a property is missing, or a value is not finite (opacity logits may be
/// infinite).
pub(crate) fn open<'a>(path: &Path, content: Content<'a>) -> Result<OpenScene<'a>> {
    let header = Header::of(path, &content)?;
    let (before, vertex) = header.vertices(path)?;
    let drawing = Drawing::antialiased(header.antialiased);
    if vertex.has("packed_position") {
        return Ok(OpenScene { gaussians: Box::new(compressed::decode(path, &content.all()?)?), drawing });
    }
    if header.format == Format::Ascii {
        let values = ascii(path, &content.all()?[header.end..], before, vertex)?;
        let gaussians = Columns::of(path, vertex)?.gaussians(&values);
        check_values(path, &gaussians)?;
        return Ok(OpenScene { gaussians: Box::new(gaussians), drawing });
    }
    let first = header.first_vertex(path, content.len())?;
    let columns = Columns::of(path, vertex)?;
    let rows = Rows { path: path.to_path_buf(), content, first, vertex: vertex.clone(), columns };
    Ok(OpenScene { gaussians: Box::new(rows), drawing })
}

/// True if the vertices of a PLY file are Gaussians.
///
/// # Errors
/// When it cannot be read, or its header is malformed.
pub(crate) fn is_scene(path: &Path) -> Result<bool> {
    let header = Header::of(path, &Content::open(path)?)?;
    let (_, vertex) = header.vertices(path)?;
    Ok(vertex.has("scale_0") || vertex.has("packed_position"))
}

/// The vertices of a binary file.
struct Rows<'a> {
    path: PathBuf,
    content: Content<'a>,
    /// The place of the first row.
    first: usize,
    vertex: Element,
    columns: Columns,
}

impl Blocks for Rows<'_> {
    fn len(&self) -> usize {
        self.vertex.count
    }

    fn degree(&self) -> usize {
        self.columns.degree
    }

    fn block(&self, rows: Range<usize>) -> Result<Cow<'_, Gaussians>> {
        let place = |row: usize| self.first + row * self.vertex.stride();
        let bytes = self.content.part(place(rows.start)..place(rows.end))?;
        let gaussians = self.columns.gaussians(&self.vertex.numbers(&bytes));
        check_rows(&self.path, &gaussians, rows.start)?;
        Ok(Cow::Owned(gaussians))
    }
}

/// The places of the numbers of a Gaussian in a row.
struct Columns {
    /// Numbers of a row.
    width: usize,
    degree: usize,
    xyz: Vec<usize>,
    scale: Vec<usize>,
    rotation: Option<Vec<usize>>,
    opacity: Option<usize>,
    dc: Option<Vec<usize>>,
    rgb: Option<Vec<usize>>,
    rest: Vec<usize>,
}

impl Columns {
    fn of(path: &Path, vertex: &Element) -> Result<Self> {
        if !vertex.has("scale_0") {
            let found = "a point cloud: no property scale_0";
            return Err(Error::invalid(path, "element vertex", "Gaussians", found));
        }
        let rest = vertex.names.iter().filter(|n| n.starts_with("f_rest_")).count();
        let Some(degree) = (0..=sh::MAX_DEGREE).find(|d| 3 * (sh::coefficients(*d) - 1) == rest) else {
            let expected = "0, 9, 24, 45 or 72 properties f_rest_*";
            return Err(Error::invalid(path, "element vertex", expected, rest));
        };
        let named =
            |names: &[&str]| -> Result<Vec<usize>> { names.iter().map(|name| vertex.position(path, name)).collect() };
        let numbered = |prefix: &str, n: usize| -> Result<Vec<usize>> {
            (0..n).map(|i| vertex.position(path, &format!("{prefix}{i}"))).collect()
        };
        Ok(Self {
            width: vertex.names.len(),
            degree,
            xyz: named(&["x", "y", "z"])?,
            scale: numbered("scale_", 3)?,
            rotation: vertex.has("rot_0").then(|| numbered("rot_", 4)).transpose()?,
            opacity: vertex.has("opacity").then(|| vertex.position(path, "opacity")).transpose()?,
            // Harmonics beyond the constant one mean nothing without it.
            dc: (rest > 0 || vertex.has("f_dc_0")).then(|| numbered("f_dc_", 3)).transpose()?,
            rgb: vertex.has("red").then(|| named(&["red", "green", "blue"])).transpose()?,
            rest: numbered("f_rest_", rest)?,
        })
    }

    /// The Gaussians of rows.
    fn gaussians(&self, values: &[f32]) -> Gaussians {
        let per_channel = self.rest.len() / 3;
        let n = values.len() / self.width;
        let mut gaussians = Gaussians { degree: self.degree, ..Gaussians::default() };
        gaussians.sh.reserve_exact(n * 3 * (per_channel + 1));
        for row in values.chunks_exact(self.width) {
            gaussians.means.push(std::array::from_fn(|i| row[self.xyz[i]]));
            gaussians.log_scales.push(std::array::from_fn(|i| row[self.scale[i]]));
            let identity = [1.0, 0.0, 0.0, 0.0];
            gaussians.quats.push(self.rotation.as_ref().map_or(identity, |c| std::array::from_fn(|i| row[c[i]])));
            gaussians.opacity_logits.push(self.opacity.map_or(f32::INFINITY, |c| row[c]));
            match (&self.dc, &self.rgb) {
                (Some(dc), _) => gaussians.sh.extend(dc.iter().map(|&c| row[c])),
                (None, Some(rgb)) => gaussians.sh.extend(rgb.iter().map(|&c| forms::harmonic(row[c] / 255.0))),
                (None, None) => gaussians.sh.extend([0.0; 3]),
            }
            for k in 0..per_channel {
                gaussians.sh.extend((0..3).map(|channel| row[self.rest[channel * per_channel + k]]));
            }
        }
        gaussians
    }
}

/// Writes a 3DGS PLY file, binary little-endian, with the properties of the reference implementation in its order;
/// normals are zero.
///
/// # Errors
/// When a value is not finite, but for opacity logits.
pub(crate) fn encode(path: &Path, gaussians: &dyn Blocks, drawing: Drawing, w: &mut dyn Write) -> Result<()> {
    header(gaussians, drawing, w).map_err(Error::io(path))?;
    for rows in gaussians.blocks() {
        let block = gaussians.block(rows.clone())?;
        check_rows(path, &block, rows.start)?;
        written(&block, w).map_err(Error::io(path))?;
    }
    Ok(())
}

fn header(gaussians: &dyn Blocks, drawing: Drawing, w: &mut dyn Write) -> io::Result<()> {
    let rest = 3 * (sh::coefficients(gaussians.degree()) - 1);
    writeln!(w, "{}element vertex {}", first_lines(drawing), gaussians.len())?;
    for name in ["x", "y", "z", "nx", "ny", "nz"] {
        writeln!(w, "property float {name}")?;
    }
    for (prefix, count) in [("f_dc_", 3), ("f_rest_", rest)] {
        (0..count).try_for_each(|i| writeln!(w, "property float {prefix}{i}"))?;
    }
    writeln!(w, "property float opacity")?;
    for (prefix, count) in [("scale_", 3), ("rot_", 4)] {
        (0..count).try_for_each(|i| writeln!(w, "property float {prefix}{i}"))?;
    }
    writeln!(w, "end_header")
}

fn written(gaussians: &Gaussians, w: &mut dyn Write) -> io::Result<()> {
    let k = gaussians.coefficients();
    for i in 0..gaussians.len() {
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
