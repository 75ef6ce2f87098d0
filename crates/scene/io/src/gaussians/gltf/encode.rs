//! Documents of Gaussians.

use super::{BINARY, EXTENSION, JSON, MAGIC, harmonics, signs};
use crate::gaussians::blocks::Blocks;
use crate::gaussians::fields::{check_rows, unit};
use crate::gaussians::order::bounds;
use crate::{Error, Result};
use base64::engine::general_purpose::STANDARD;
use base64::write::EncoderWriter;
use serde_json::{Value, json};
use std::io::{self, Write};
use std::path::Path;
use weaver_scene::{Gaussians, forms};

const FLOAT: u32 = 5126;
const SHORT: u32 = 5123;
/// The target of views of attributes.
const ARRAY_BUFFER: u32 = 34962;

/// Bytes of attributes that are gathered in a pass over all Gaussians, if there are more than one in it.
const GATHERED: usize = 1 << 29;

pub(super) fn glb(path: &Path, gaussians: &dyn Blocks, w: &mut dyn Write) -> Result<()> {
    let attributes = attributes(gaussians.degree());
    let mut json = document(gaussians.len(), &attributes, &corners(path, gaussians)?, None).to_string().into_bytes();
    json.resize(json.len().next_multiple_of(4), b' ');
    let length = gaussians.len() * attributes.iter().map(Attribute::size).sum::<usize>();
    let whole = 12 + 8 + json.len() + if length > 0 { 8 + length } else { 0 };
    let Ok(size) = u32::try_from(whole) else {
        return Err(Error::invalid(path, "Gaussians to write", "less than 4 GB", format!("{whole} bytes")));
    };
    let head = |w: &mut dyn Write| -> io::Result<()> {
        w.write_all(MAGIC)?;
        for word in [2, size, json.len() as u32, JSON] {
            w.write_all(&word.to_le_bytes())?;
        }
        w.write_all(&json)?;
        let binary = [length as u32, BINARY];
        binary.iter().filter(|_| length > 0).try_for_each(|word| w.write_all(&word.to_le_bytes()))
    };
    head(w).map_err(Error::io(path))?;
    binary(path, gaussians, (&attributes, GATHERED), w)
}

pub(super) fn gltf(path: &Path, gaussians: &dyn Blocks, w: &mut dyn Write) -> Result<()> {
    let attributes = attributes(gaussians.degree());
    let start = "data:application/octet-stream;base64,";
    let json = document(gaussians.len(), &attributes, &corners(path, gaussians)?, Some(start)).to_string();
    // The buffer stands within the document; there is none without Gaussians.
    let (head, tail) = json.split_at(json.find(start).map_or(json.len(), |at| at + start.len()));
    w.write_all(head.as_bytes()).map_err(Error::io(path))?;
    if !tail.is_empty() {
        let mut coded = EncoderWriter::new(&mut *w, &STANDARD);
        binary(path, gaussians, (&attributes, GATHERED), &mut coded)?;
        coded.finish().map_err(Error::io(path))?;
    }
    w.write_all(tail.as_bytes()).map_err(Error::io(path))
}

/// Adds the numbers of one Gaussian, as bytes.
type Row = Box<dyn Fn(&Gaussians, usize, &mut Vec<u8>)>;

/// An attribute: its name, type, components of each element, and numbers.
struct Attribute {
    name: String,
    component: u32,
    components: usize,
    row: Row,
}

impl Attribute {
    /// Bytes of an element.
    fn size(&self) -> usize {
        self.components * if self.component == FLOAT { 4 } else { 2 }
    }
}

/// The attributes of Gaussians of a degree.
fn attributes(degree: usize) -> Vec<Attribute> {
    let named = |name: &str| format!("{EXTENSION}:{name}");
    let rotation = |of: &Gaussians, i: usize| {
        let [w, x, y, z] = unit(of.quats[i]);
        // The inverse of reading: minus half a turn about z, then xyzw.
        [y, -x, -w, z]
    };
    let color = |of: &Gaussians, i: usize| {
        let [r, g, b] = [0, 1, 2].map(|c| linear(forms::color(of.sh[3 * of.coefficients() * i + c]).clamp(0.0, 1.0)));
        [r, g, b, forms::opacity(of.opacity_logits[i])].map(|x| ((65535.0 * x).round() as u16).to_le_bytes())
    };
    let color: Row = Box::new(move |of, i, out| out.extend(color(of, i).as_flattened()));
    let mut attributes = vec![
        floats("POSITION", |of, i| position(of.means[i])),
        Attribute { name: "COLOR_0".into(), component: SHORT, components: 4, row: color },
        floats(&named("ROTATION"), rotation),
        floats(&named("SCALE"), |of, i| of.log_scales[i].map(f32::exp)),
        floats(&named("OPACITY"), |of, i| [forms::opacity(of.opacity_logits[i])]),
    ];
    let signs = signs();
    for (coefficient, name) in (0..=degree).flat_map(harmonics).enumerate() {
        let sign = signs[coefficient];
        attributes.push(floats(&name, move |of, i| {
            [0, 1, 2].map(|c| sign * of.sh[3 * (of.coefficients() * i + coefficient) + c])
        }));
    }
    attributes
}

fn floats<const N: usize>(name: &str, numbers: impl Fn(&Gaussians, usize) -> [f32; N] + 'static) -> Attribute {
    let row: Row = Box::new(move |of, i, out| out.extend(numbers(of, i).map(f32::to_le_bytes).as_flattened()));
    Attribute { name: name.into(), component: FLOAT, components: N, row }
}

/// The linear value of one in sRGB, as `COLOR_0` is linear (IEC 61966-2-1).
fn linear(x: f32) -> f32 {
    if x <= 0.04045 { x / 12.92 } else { ((x + 0.055) / 1.055).powf(2.4) }
}

fn position([x, y, z]: [f32; 3]) -> [f32; 3] {
    [-x, -y, z]
}

/// The corners of the box of all positions as they are written: the least and the largest. Values are checked on the
/// way.
fn corners(path: &Path, gaussians: &dyn Blocks) -> Result<[[f32; 3]; 2]> {
    let mut points = Vec::new();
    let mut corners = [[0.0; 3]; 2];
    for rows in gaussians.blocks() {
        let block = gaussians.block(rows.clone())?;
        check_rows(path, &block, rows.start)?;
        points.extend(block.means.iter().map(|mean| position(*mean)));
        let bounds = bounds(&points);
        corners = [0, 1].map(|side| bounds.map(|axis| axis[side]));
        points.clear();
        points.extend(corners);
    }
    Ok(corners)
}

/// Writes one attribute after the other. As many as fit into `gathered` bytes are gathered in one pass over the
/// Gaussians, and one at least.
fn binary(
    path: &Path,
    gaussians: &dyn Blocks,
    (attributes, gathered): (&[Attribute], usize),
    w: &mut dyn Write,
) -> Result<()> {
    let length = |attribute: &Attribute| attribute.size() * gaussians.len();
    let mut left = attributes;
    while !left.is_empty() {
        let mut bytes = 0;
        let fits = |attribute: &&Attribute| {
            bytes += length(attribute);
            bytes <= gathered
        };
        let (now, later) = left.split_at(left.iter().take_while(fits).count().max(1));
        let mut columns: Vec<Vec<u8>> = now.iter().map(|attribute| Vec::with_capacity(length(attribute))).collect();
        for rows in gaussians.blocks() {
            let block = gaussians.block(rows)?;
            for (attribute, column) in now.iter().zip(&mut columns) {
                (0..block.len()).for_each(|i| (attribute.row)(&block, i, column));
            }
        }
        columns.iter().try_for_each(|column| w.write_all(column)).map_err(Error::io(path))?;
        left = later;
    }
    Ok(())
}

/// The document, whose buffer is the binary chunk unless there is a URI.
fn document(n: usize, attributes: &[Attribute], corners: &[[f32; 3]; 2], uri: Option<&str>) -> Value {
    let asset = json!({ "version": "2.0", "generator": "SplatWeaver" });
    // Accessors without elements are not allowed.
    if n == 0 {
        return json!({ "asset": asset, "extensionsUsed": [EXTENSION], "scene": 0, "scenes": [{}] });
    }
    let (mut views, mut accessors, mut start) = (Vec::new(), Vec::new(), 0);
    for (i, attribute) in attributes.iter().enumerate() {
        let length = n * attribute.size();
        views.push(json!({ "buffer": 0, "byteOffset": start, "byteLength": length, "target": ARRAY_BUFFER }));
        start += length;
        let kind = ["SCALAR", "VEC2", "VEC3", "VEC4"][attribute.components - 1];
        accessors.push(json!({ "bufferView": i, "componentType": attribute.component, "count": n, "type": kind }));
        if attribute.component != FLOAT {
            accessors[i]["normalized"] = true.into();
        }
    }
    accessors[0]["min"] = json!(corners[0]);
    accessors[0]["max"] = json!(corners[1]);
    let mut buffer = json!({ "byteLength": start });
    if let Some(uri) = uri {
        buffer["uri"] = uri.into();
    }
    let indices: serde_json::Map<String, Value> =
        attributes.iter().enumerate().map(|(i, attribute)| (attribute.name.clone(), i.into())).collect();
    let splatting = json!({
        "kernel": "ellipse",
        "colorSpace": "srgb_rec709_display",
        "sortingMethod": "cameraDistance",
        "projection": "perspective",
    });
    json!({
        "asset": asset,
        "extensionsUsed": [EXTENSION],
        "scene": 0,
        "scenes": [{ "nodes": [0] }],
        "nodes": [{ "mesh": 0 }],
        "meshes": [{ "primitives": [{ "attributes": indices, "mode": 0, "extensions": { EXTENSION: splatting } }] }],
        "accessors": accessors,
        "bufferViews": views,
        "buffers": [buffer],
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn passes_of_any_size_write_the_same_bytes() {
        let n = 3;
        let number = |i: usize| (i as f32).sin();
        let gaussians = Gaussians {
            means: (0..n).map(|i| [0, 1, 2].map(|c| number(3 * i + c))).collect(),
            log_scales: vec![[-1.0, -2.0, -3.0]; n],
            quats: vec![[1.0, 0.5, 0.0, 0.0]; n],
            opacity_logits: (0..n).map(number).collect(),
            sh: (0..n * 12).map(number).collect(),
            degree: 1,
        };
        let written = |gathered: usize| {
            let mut bytes = Vec::new();
            binary("a.glb".as_ref(), &gaussians, (&attributes(1), gathered), &mut bytes).unwrap();
            bytes
        };
        let whole = written(GATHERED);
        assert_eq!(whole.len(), n * (12 + 8 + 16 + 12 + 4 + 4 * 12));
        assert!([0, 1, 40, 100].iter().all(|gathered| written(*gathered) == whole));
    }
}
