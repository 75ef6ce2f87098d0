//! Documents of Gaussians.

use super::{BINARY, EXTENSION, JSON, MAGIC, harmonics, signs};
use crate::gaussians::fields::{byte, check_values, unit};
use crate::gaussians::order::bounds;
use crate::{Error, Result};
use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use serde_json::{Value, json};
use std::io::{self, Write};
use std::path::Path;
use weaver_scene::{Gaussians, forms};

const FLOAT: u32 = 5126;
const BYTE: u32 = 5121;
/// The target of views of attributes.
const ARRAY_BUFFER: u32 = 34962;

pub(super) fn glb(path: &Path, gaussians: &Gaussians, w: &mut dyn Write) -> Result<()> {
    check_values(path, gaussians)?;
    let attributes = attributes(gaussians);
    let mut json = document(gaussians, &attributes, None).to_string().into_bytes();
    json.resize(json.len().next_multiple_of(4), b' ');
    let length = length(gaussians, &attributes);
    let whole = 12 + 8 + json.len() + if length > 0 { 8 + length } else { 0 };
    let Ok(size) = u32::try_from(whole) else {
        return Err(Error::invalid(path, "Gaussians to write", "less than 4 GB", format!("{whole} bytes")));
    };
    let write = |w: &mut dyn Write| -> io::Result<()> {
        w.write_all(MAGIC)?;
        for word in [2, size, json.len() as u32, JSON] {
            w.write_all(&word.to_le_bytes())?;
        }
        w.write_all(&json)?;
        if length > 0 {
            for word in [length as u32, BINARY] {
                w.write_all(&word.to_le_bytes())?;
            }
        }
        binary(gaussians, &attributes, w)
    };
    write(w).map_err(Error::io(path))
}

pub(super) fn gltf(path: &Path, gaussians: &Gaussians, w: &mut dyn Write) -> Result<()> {
    check_values(path, gaussians)?;
    let attributes = attributes(gaussians);
    let write = |w: &mut dyn Write| -> io::Result<()> {
        let mut bytes = Vec::new();
        binary(gaussians, &attributes, &mut bytes)?;
        let mut uri = "data:application/octet-stream;base64,".to_string();
        STANDARD.encode_string(&bytes, &mut uri);
        serde_json::to_writer(w, &document(gaussians, &attributes, Some(uri))).map_err(io::Error::from)
    };
    write(w).map_err(Error::io(path))
}

/// The numbers of one Gaussian, as bytes.
type Row<'a> = Box<dyn Fn(usize, &mut Vec<u8>) + 'a>;

/// An attribute: its name, type, components of each element, and numbers.
struct Attribute<'a> {
    name: String,
    component: u32,
    components: usize,
    row: Row<'a>,
}

impl Attribute<'_> {
    fn size(&self) -> usize {
        self.components * if self.component == FLOAT { 4 } else { 1 }
    }
}

fn attributes(gaussians: &Gaussians) -> Vec<Attribute<'_>> {
    let k = gaussians.coefficients();
    let named = |name: &str| format!("{EXTENSION}:{name}");
    let rotation = |i: usize| {
        let [w, x, y, z] = unit(gaussians.quats[i]);
        // The inverse of reading: minus half a turn about z, then xyzw.
        [y, -x, -w, z]
    };
    let color = move |i: usize| {
        let [r, g, b] = [0, 1, 2].map(|c| forms::color(gaussians.sh[3 * k * i + c]));
        [r, g, b, forms::opacity(gaussians.opacity_logits[i])].map(|x| byte(255.0 * x))
    };
    let mut attributes = vec![
        floats("POSITION", 3, Box::new(|i, out| push(out, position(gaussians.means[i])))),
        Attribute {
            name: "COLOR_0".into(),
            component: BYTE,
            components: 4,
            row: Box::new(move |i, out| out.extend(color(i))),
        },
        floats(&named("ROTATION"), 4, Box::new(move |i, out| push(out, rotation(i)))),
        floats(&named("SCALE"), 3, Box::new(|i, out| push(out, gaussians.log_scales[i].map(f32::exp)))),
        floats(&named("OPACITY"), 1, Box::new(|i, out| push(out, [forms::opacity(gaussians.opacity_logits[i])]))),
    ];
    let signs = signs();
    for (coefficient, name) in (0..=gaussians.degree).flat_map(harmonics).enumerate() {
        let sign = signs[coefficient];
        let rgb = move |i: usize| [0, 1, 2].map(|c| sign * gaussians.sh[3 * (k * i + coefficient) + c]);
        attributes.push(floats(&name, 3, Box::new(move |i, out| push(out, rgb(i)))));
    }
    attributes
}

fn floats<'a>(name: &str, components: usize, row: Row<'a>) -> Attribute<'a> {
    Attribute { name: name.into(), component: FLOAT, components, row }
}

fn position([x, y, z]: [f32; 3]) -> [f32; 3] {
    [-x, -y, z]
}

fn push<const N: usize>(out: &mut Vec<u8>, numbers: [f32; N]) {
    numbers.iter().for_each(|x| out.extend(x.to_le_bytes()));
}

/// Bytes of the buffer.
fn length(gaussians: &Gaussians, attributes: &[Attribute]) -> usize {
    gaussians.len() * attributes.iter().map(Attribute::size).sum::<usize>()
}

/// Gaussians whose bytes are kept before they are written.
const BLOCK: usize = 4096;

fn binary(gaussians: &Gaussians, attributes: &[Attribute], w: &mut dyn Write) -> io::Result<()> {
    let mut block = Vec::new();
    for attribute in attributes {
        for i in 0..gaussians.len() {
            (attribute.row)(i, &mut block);
            if (i + 1).is_multiple_of(BLOCK) || i + 1 == gaussians.len() {
                w.write_all(&block)?;
                block.clear();
            }
        }
    }
    Ok(())
}

/// The document, whose buffer is the binary chunk unless there is a URI.
fn document(gaussians: &Gaussians, attributes: &[Attribute], uri: Option<String>) -> Value {
    let n = gaussians.len();
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
    let turned: Vec<[f32; 3]> = gaussians.means.iter().map(|mean| position(*mean)).collect();
    let bounds = bounds(&turned);
    accessors[0]["min"] = json!(bounds.map(|[min, _]| min));
    accessors[0]["max"] = json!(bounds.map(|[_, max]| max));
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
