//! Gaussians from the primitives of a document.

use super::accessors::{Accessors, Allowed, FLOAT};
use super::buffers::Buffers;
use super::document::{Document, Mesh, Primitive, Splatting};
use super::{EXTENSION, PACKED, harmonics, invalid, nodes, signs};
use crate::files::content::Content;
use crate::gaussians::blocks::Blocks;
use crate::gaussians::fields::check_rows;
use crate::gaussians::placement::Placement;
use crate::gaussians::spz;
use crate::{Error, Result};
use std::borrow::Cow;
use std::ops::Range;
use std::path::Path;
use weaver_scene::{Gaussians, forms};

/// Extensions that a file may require; the last lets positions be integers.
const KNOWN: [&str; 3] = [EXTENSION, PACKED, "KHR_mesh_quantization"];
/// The largest degree of the extension.
const DEGREE: usize = 3;
const POINTS: u64 = 0;

/// Types of attributes; of positions those of KHR_mesh_quantization, too.
const POSITION: Allowed<'_> = &[
    FLOAT,
    (5120, false),
    (5120, true),
    (5121, false),
    (5121, true),
    (5122, false),
    (5122, true),
    (5123, false),
    (5123, true),
];
const ROTATION: Allowed<'_> = &[FLOAT, (5120, true), (5122, true)];
const SCALE: Allowed<'_> = &[FLOAT, (5121, false), (5121, true), (5123, false), (5123, true)];
const OPACITY: Allowed<'_> = &[FLOAT, (5121, true), (5123, true)];

/// Opens a document: its Gaussians are read on demand, or at once from sparse accessors.
pub(super) fn open<'a>(path: &Path, file: Content<'a>) -> Result<Box<dyn Blocks + 'a>> {
    let (document, binary) = Document::read(path, &file)?;
    if let Some(other) = document.extensions_required.iter().find(|name| !KNOWN.contains(&name.as_str())) {
        return Err(Error::invalid(path, "extensionsRequired", KNOWN.join(" or "), other));
    }
    if !document.extensions_used.iter().any(|name| name == EXTENSION) {
        return Err(Error::invalid(path, "extensionsUsed", EXTENSION, document.extensions_used.join(", ")));
    }
    let placed = nodes::placed(path, &document)?;
    let Document { buffers, buffer_views, accessors, meshes, .. } = document;
    let buffers = Buffers::open(path, (file, binary), &buffers, buffer_views)?;
    let accessors = Accessors { path: path.to_path_buf(), accessors, buffers };
    let (most, mut count) = (accessors.buffers.len(), 0_usize);
    let mut scene = Primitives { accessors, meshes, parts: Vec::new() };
    for (mesh, to) in placed {
        let Some(primitives) = scene.meshes.get(mesh) else {
            return Err(Error::invalid(path, "nodes", format!("a mesh below {}", scene.meshes.len()), mesh));
        };
        for index in 0..primitives.primitives.len() {
            let Some(part) = scene.part([mesh, index], to)? else { continue };
            count = part.count.saturating_add(count);
            // A mesh may be shown many times, and its numbers may be zeros that take no bytes.
            if count > most {
                let expected = format!("at most {most} Gaussians in buffers of this length");
                return Err(Error::invalid(path, place(part.of), expected, count));
            }
            // Finds faults that do not depend on the numbers.
            scene.gaussians(&part, 0..0)?;
            if part.count > 0 {
                scene.parts.push(part);
            }
        }
    }
    // Sparse elements are found by going through all that are.
    Ok(if scene.accessors.are_sparse() { Box::new(scene.block(0..count)?.into_owned()) } else { Box::new(scene) })
}

/// The Gaussians of a document: of one primitive after the other, as often as nodes show it.
struct Primitives<'a> {
    accessors: Accessors<'a>,
    meshes: Vec<Mesh>,
    parts: Vec<Part<'a>>,
}

/// A primitive of Gaussians where a node shows it.
struct Part<'a> {
    /// Numbers of its mesh, and of the primitive in that.
    of: [usize; 2],
    to: Option<Placement>,
    count: usize,
    degree: usize,
    /// Where the Gaussians come from, if not from attributes.
    packed: Option<Box<dyn Blocks + 'a>>,
}

/// Place of a primitive in the document, for messages.
fn place([mesh, primitive]: [usize; 2]) -> String {
    format!("meshes[{mesh}].primitives[{primitive}]")
}

impl Blocks for Primitives<'_> {
    fn len(&self) -> usize {
        self.parts.iter().map(|part| part.count).sum()
    }

    fn degree(&self) -> usize {
        self.parts.iter().map(|part| part.degree).max().unwrap_or(0)
    }

    fn block(&self, rows: Range<usize>) -> Result<Cow<'_, Gaussians>> {
        let mut found = Gaussians { degree: self.degree(), ..Gaussians::default() };
        let mut first = 0;
        for part in &self.parts {
            let within = |row: usize| row.clamp(first, first + part.count) - first;
            let some = within(rows.start)..within(rows.end);
            if !some.is_empty() {
                found.append(&self.gaussians(part, some)?);
            }
            first += part.count;
        }
        turn(&mut found);
        check_rows(&self.accessors.path, &found, rows.start)?;
        Ok(Cow::Owned(found))
    }
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

impl<'a> Primitives<'a> {
    fn primitive(&self, [mesh, index]: [usize; 2]) -> &Primitive {
        &self.meshes[mesh].primitives[index]
    }

    /// A primitive as a node shows it, if it is one of Gaussians.
    fn part(&self, of: [usize; 2], to: Option<Placement>) -> Result<Option<Part<'a>>> {
        let primitive = self.primitive(of);
        let Some(splatting) = &primitive.extensions.splatting else { return Ok(None) };
        check(&self.accessors.path, &place(of), primitive.mode, splatting)?;
        let count = self.accessors.count(self.attribute(of, "POSITION")?)?;
        if let Some(packed) = &splatting.extensions.spz {
            let path = self.accessors.path.join(place(of));
            let view = self.accessors.buffers.view(packed.buffer_view)?;
            let file = Content::Memory(view.part(0..view.length)?.into_owned().into());
            let packed = spz::open(&path, file)?.gaussians;
            if packed.len() != count {
                return Err(Error::invalid(&path, PACKED, format!("{count} Gaussians, as POSITION has"), packed.len()));
            }
            return Ok(Some(Part { of, to, count, degree: packed.degree(), packed: Some(packed) }));
        }
        // A degree asks for all of its attributes and for those of lower ones.
        let is_begun = |degree: &usize| harmonics(*degree).any(|name| primitive.attributes.contains_key(&name));
        let degree = (1..=DEGREE).rev().find(is_begun).unwrap_or(0);
        Ok(Some(Part { of, to, count, degree, packed: None }))
    }

    /// Some Gaussians of a part, with the axes of glTF.
    fn gaussians(&self, part: &Part<'_>, rows: Range<usize>) -> Result<Gaussians> {
        let gaussians = match &part.packed {
            Some(packed) => {
                let mut gaussians = packed.block(rows)?.into_owned();
                turn(&mut gaussians);
                gaussians
            }
            None => self.of_attributes(part, rows)?,
        };
        Ok(part.to.as_ref().map(|to| to.apply(&gaussians)).unwrap_or(gaussians))
    }

    fn of_attributes(&self, part: &Part<'_>, rows: Range<usize>) -> Result<Gaussians> {
        let of = |name: &str| format!("{EXTENSION}:{name}");
        let quats: Vec<[f32; 4]> = self.read(part, (&of("ROTATION"), ROTATION), &rows)?;
        let scales: Vec<[f32; 3]> = self.read(part, (&of("SCALE"), SCALE), &rows)?;
        let opacities: Vec<[f32; 1]> = self.read(part, (&of("OPACITY"), OPACITY), &rows)?;
        let harmonics = (0..=part.degree).flat_map(harmonics);
        let coefficients = harmonics.map(|name| self.read::<3>(part, (&name, &[FLOAT]), &rows));
        let coefficients = coefficients.collect::<Result<Vec<_>>>()?;
        let refused = |expected, i: usize, found: &[f32]| {
            let found = format!("{found:?} at {}", rows.start + i);
            Err(Error::invalid(&self.accessors.path, place(part.of), expected, found))
        };
        if let Some(i) = scales.iter().position(|scale| scale.iter().any(|scale| *scale < 0.0)) {
            return refused("scales of 0 and more", i, &scales[i]);
        }
        if let Some(i) = opacities.iter().position(|[opacity]| !(0.0..=1.0).contains(opacity)) {
            return refused("opacities from 0 to 1", i, &opacities[i]);
        }
        Ok(Gaussians {
            means: self.read(part, ("POSITION", POSITION), &rows)?,
            log_scales: scales.iter().map(|s| s.map(|s| s.max(f32::MIN_POSITIVE).ln())).collect(),
            quats: quats.iter().map(|[x, y, z, w]| [*w, *x, *y, *z]).collect(),
            opacity_logits: opacities.iter().map(|[o]| forms::opacity_logit(*o)).collect(),
            sh: (0..rows.len()).flat_map(|i| coefficients.iter().flat_map(move |of| of[i])).collect(),
            degree: part.degree,
        })
    }

    /// The number of the accessor of an attribute.
    fn attribute(&self, of: [usize; 2], name: &str) -> Result<usize> {
        let invalid = || Error::invalid(&self.accessors.path, place(of), format!("an attribute {name}"), "none");
        self.primitive(of).attributes.get(name).copied().ok_or_else(invalid)
    }

    /// Numbers of an attribute, which has one of these types.
    fn read<const N: usize>(
        &self,
        part: &Part<'_>,
        (name, allowed): (&str, Allowed<'_>),
        rows: &Range<usize>,
    ) -> Result<Vec<[f32; N]>> {
        self.accessors.read((self.attribute(part.of, name)?, allowed), part.count, rows.clone())
    }
}

/// Checks that Gaussians are as they are drawn here.
fn check(path: &Path, place: &str, mode: Option<u64>, splatting: &Splatting) -> Result<()> {
    let invalid = |expected| invalid(path, place, expected);
    if mode != Some(POINTS) {
        return Err(invalid("mode 0 (points)")(format!("{mode:?}")));
    }
    let properties = [
        ("kernel", &splatting.kernel, "ellipse"),
        ("colorSpace", &splatting.color_space, "srgb_rec709_display"),
        ("projection", &splatting.projection, "perspective"),
        ("sortingMethod", &splatting.sorting_method, "cameraDistance"),
    ];
    for (name, found, expected) in properties {
        // The draft of packed ones came before the first two were asked for.
        let is_left_out = found.is_none() && splatting.extensions.spz.is_some();
        if found.as_deref() != Some(expected) && !is_left_out {
            let found = found.as_ref().map_or_else(|| "none".into(), |found| format!("{found:?}"));
            return Err(invalid(&format!("{name} {expected:?}"))(found));
        }
    }
    Ok(())
}
