//! Gaussians from the primitives of a document.

use super::accessors::Accessors;
use super::buffers::Buffers;
use super::document::{Document, Primitive};
use super::{EXTENSION, harmonics, invalid, nodes, signs};
use crate::gaussians::fields::check_values;
use crate::{Error, Result};
use std::path::Path;
use weaver_scene::{Gaussians, forms};

/// Extensions that a file may require; the second lets positions be integers.
const KNOWN: [&str; 2] = [EXTENSION, "KHR_mesh_quantization"];
/// The largest degree of the extension.
const DEGREE: usize = 3;
const POINTS: u64 = 0;

pub(super) fn decoded(path: &Path, data: &[u8]) -> Result<Gaussians> {
    let (document, binary) = Document::read(path, data)?;
    if let Some(other) = document.extensions_required.iter().find(|name| !KNOWN.contains(&name.as_str())) {
        return Err(Error::invalid(path, "extensionsRequired", KNOWN.join(" or "), other));
    }
    if !document.extensions_used.iter().any(|name| name == EXTENSION) {
        return Err(Error::invalid(path, "extensionsUsed", EXTENSION, document.extensions_used.join(", ")));
    }
    let buffers = Buffers::read(path, &document.buffers, &document.buffer_views, binary)?;
    let (most, mut count) = (buffers.len(), 0);
    let accessors = Accessors { path, accessors: &document.accessors, buffers };
    let mut parts = Vec::new();
    for (mesh, to) in nodes::placed(path, &document)? {
        let Some(primitives) = document.meshes.get(mesh) else {
            return Err(Error::invalid(path, "nodes", format!("a mesh below {}", document.meshes.len()), mesh));
        };
        for (i, primitive) in primitives.primitives.iter().enumerate() {
            if primitive.extensions.splatting.is_none() {
                continue;
            }
            let place = format!("meshes[{mesh}].primitives[{i}]");
            let attributes = Attributes { path, place: &place, primitive, accessors: &accessors };
            count += attributes.count()?;
            // A mesh may be shown many times, and its numbers may be zeros that take no bytes.
            if count > most {
                let expected = format!("at most {most} Gaussians in buffers of this length");
                return Err(Error::invalid(path, place, expected, count));
            }
            let part = attributes.gaussians()?;
            parts.push(match &to {
                Some(to) => part.transformed(to),
                None => part,
            });
        }
    }
    let mut gaussians = if parts.len() == 1 { parts.remove(0) } else { Gaussians::joined(&parts) };
    turn(&mut gaussians);
    check_values(path, &gaussians)?;
    Ok(gaussians)
}

/// Half a turn about z.
fn turn(gaussians: &mut Gaussians) {
    gaussians.means.iter_mut().for_each(|[x, y, _]| (*x, *y) = (-*x, -*y));
    gaussians.quats.iter_mut().for_each(|[w, x, y, z]| (*w, *x, *y, *z) = (-*z, -*y, *x, *w));
    let (signs, width) = (signs(), 3 * gaussians.coefficients());
    for row in gaussians.sh.chunks_exact_mut(width) {
        row.as_chunks_mut::<3>().0.iter_mut().zip(signs).for_each(|(rgb, sign)| *rgb = rgb.map(|x| sign * x));
    }
}

/// The attributes of a primitive of Gaussians.
struct Attributes<'a> {
    path: &'a Path,
    place: &'a str,
    primitive: &'a Primitive,
    accessors: &'a Accessors<'a>,
}

impl Attributes<'_> {
    fn count(&self) -> Result<usize> {
        self.accessors.count(self.index("POSITION")?)
    }

    fn gaussians(&self) -> Result<Gaussians> {
        self.check()?;
        let n = self.count()?;
        let mut degree = 0;
        while degree < DEGREE && harmonics(degree + 1).any(|name| self.primitive.attributes.contains_key(&name)) {
            degree += 1;
        }
        let of = |name: &str| format!("{EXTENSION}:{name}");
        let quats: Vec<[f32; 4]> = self.read(&of("ROTATION"), n)?;
        let scales: Vec<[f32; 3]> = self.read(&of("SCALE"), n)?;
        let opacities: Vec<[f32; 1]> = self.read(&of("OPACITY"), n)?;
        let coefficients = (0..=degree).flat_map(harmonics).map(|name| self.read::<3>(&name, n));
        let coefficients = coefficients.collect::<Result<Vec<_>>>()?;
        if let Some(i) = scales.as_flattened().iter().position(|scale| *scale < 0.0) {
            let found = format!("{:?} at {}", scales[i / 3], i / 3);
            return Err(Error::invalid(self.path, self.place, "scales of 0 and more", found));
        }
        Ok(Gaussians {
            means: self.read("POSITION", n)?,
            log_scales: scales.iter().map(|s| s.map(|s| s.max(f32::MIN_POSITIVE).ln())).collect(),
            quats: quats.iter().map(|[x, y, z, w]| [*w, *x, *y, *z]).collect(),
            opacity_logits: opacities.iter().map(|[o]| forms::opacity_logit(*o)).collect(),
            sh: (0..n).flat_map(|i| coefficients.iter().flat_map(move |of| of[i])).collect(),
            degree,
        })
    }

    /// That these are Gaussians as they are drawn here.
    fn check(&self) -> Result<()> {
        let invalid = |expected| invalid(self.path, self.place, expected);
        if self.primitive.mode != Some(POINTS) {
            return Err(invalid("mode 0 (points)")(format!("{:?}", self.primitive.mode)));
        }
        let Some(splatting) = &self.primitive.extensions.splatting else { return Ok(()) };
        match (splatting.kernel.as_deref(), splatting.color_space.as_deref()) {
            (Some("ellipse") | None, Some("srgb_rec709_display") | None) => Ok(()),
            (kernel, space) => Err(invalid("kernel ellipse and colorSpace srgb_rec709_display")(format!(
                "{} and {}",
                kernel.unwrap_or("ellipse"),
                space.unwrap_or("srgb_rec709_display")
            ))),
        }
    }

    fn index(&self, name: &str) -> Result<usize> {
        let invalid = || Error::invalid(self.path, self.place, format!("an attribute {name}"), "none");
        self.primitive.attributes.get(name).copied().ok_or_else(invalid)
    }

    fn read<const N: usize>(&self, name: &str, count: usize) -> Result<Vec<[f32; N]>> {
        self.accessors.read(self.index(name)?, count)
    }
}
