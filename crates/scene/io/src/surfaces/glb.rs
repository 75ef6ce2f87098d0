//! Surfaces as binary glTF 2.0.
//!
//! Source: registry.khronos.org/glTF/specs/2.0, with the extension KHR_materials_unlit: photos have their light in
//! them.

use super::Surface;
use crate::{Error, Result, atomic_write};
use serde_json::{Value, json};
use std::path::Path;

const FLOAT: u32 = 5126;
const SHORT: u32 = 5123;
const INDEX: u32 = 5125;
/// Targets of views of attributes and of indices.
const ATTRIBUTES: u32 = 34962;
const INDICES: u32 = 34963;
/// Quality of the picture, as libjpeg counts it.
const QUALITY: u8 = 95;
const UNLIT: &str = "KHR_materials_unlit";

pub fn write(path: &Path, surface: &Surface<'_>) -> Result<()> {
    let document = Document::new(surface).map_err(Error::io(path))?;
    let mut json = document.json(surface.triangles.is_empty()).to_string().into_bytes();
    json.resize(json.len().next_multiple_of(4), b' ');
    let binary = &document.binary;
    let whole = 12 + 8 + json.len() + 8 + binary.len();
    let Ok(size) = u32::try_from(whole) else {
        return Err(Error::invalid(path, "surface to write", "less than 4 GB", format!("{whole} bytes")));
    };
    atomic_write(path, |w| {
        w.write_all(b"glTF")?;
        for word in [2, size, json.len() as u32] {
            w.write_all(&word.to_le_bytes())?;
        }
        w.write_all(b"JSON")?;
        w.write_all(&json)?;
        w.write_all(&(binary.len() as u32).to_le_bytes())?;
        w.write_all(b"BIN\0")?;
        w.write_all(binary)
    })
}

/// Bytes of a file, and the places of its parts.
#[derive(Default)]
struct Document {
    binary: Vec<u8>,
    views: Vec<Value>,
    accessors: Vec<Value>,
    attributes: serde_json::Map<String, Value>,
    textured: bool,
}

impl Document {
    fn new(surface: &Surface<'_>) -> std::io::Result<Self> {
        let mut document = Self { textured: surface.texture.is_some(), ..Self::default() };
        // Each place on the picture has a vertex of its own.
        let of: Vec<u32> = match surface.texture {
            Some(texture) => texture.vertices.to_vec(),
            None => (0..surface.vertices.len() as u32).collect(),
        };
        let corners = surface.texture.map_or(surface.triangles, |texture| texture.corners);
        let positions: Vec<[f32; 3]> = of.iter().map(|v| turned(surface.vertices[*v as usize])).collect();
        let numbers = |rows: &[[f32; 3]]| rows.as_flattened().iter().flat_map(|x| x.to_le_bytes()).collect::<Vec<u8>>();
        let bound = |pick: fn(f32, f32) -> f32, first: f32| {
            positions.iter().fold([first; 3], |all, p| std::array::from_fn(|k| pick(all[k], p[k])))
        };
        document.add(&numbers(&positions), of.len(), (FLOAT, "VEC3"), Some(ATTRIBUTES));
        document.accessors[0]["min"] = json!(bound(f32::min, f32::INFINITY));
        document.accessors[0]["max"] = json!(bound(f32::max, f32::NEG_INFINITY));
        document.attributes.insert("POSITION".into(), 0.into());
        if let Some(texture) = surface.texture {
            let bytes: Vec<u8> = texture.coordinates.as_flattened().iter().flat_map(|x| x.to_le_bytes()).collect();
            document.add(&bytes, of.len(), (FLOAT, "VEC2"), Some(ATTRIBUTES));
            document.attributes.insert("TEXCOORD_0".into(), 1.into());
        } else if !surface.colors.is_empty() {
            // Of four, so that each begins at a multiple of four bytes.
            let color = |[r, g, b]: &[u8; 3]| [linear(*r), linear(*g), linear(*b), u16::MAX].map(u16::to_le_bytes);
            let bytes: Vec<u8> = surface.colors.iter().flat_map(color).flatten().collect();
            document.add(&bytes, of.len(), (SHORT, "VEC4"), Some(ATTRIBUTES));
            document.accessors[1]["normalized"] = true.into();
            document.attributes.insert("COLOR_0".into(), 1.into());
        }
        let bytes: Vec<u8> = corners.as_flattened().iter().flat_map(|i| i.to_le_bytes()).collect();
        document.add(&bytes, 3 * corners.len(), (INDEX, "SCALAR"), Some(INDICES));
        if let Some(texture) = surface.texture {
            let jpeg = texture.picture.to_jpeg(QUALITY)?;
            document.view(&jpeg, None);
        }
        Ok(document)
    }

    /// Adds elements of a kind.
    fn add(&mut self, bytes: &[u8], count: usize, (component, kind): (u32, &str), target: Option<u32>) {
        let view = self.views.len();
        self.view(bytes, target);
        self.accessors.push(json!({ "bufferView": view, "componentType": component, "count": count, "type": kind }));
    }

    fn view(&mut self, bytes: &[u8], target: Option<u32>) {
        let mut view = json!({ "buffer": 0, "byteOffset": self.binary.len(), "byteLength": bytes.len() });
        if let Some(target) = target {
            view["target"] = target.into();
        }
        self.views.push(view);
        self.binary.extend(bytes);
        self.binary.resize(self.binary.len().next_multiple_of(4), 0);
    }

    fn json(&self, empty: bool) -> Value {
        let asset = json!({ "version": "2.0", "generator": "SplatWeaver" });
        // Accessors without elements are not allowed.
        if empty {
            return json!({ "asset": asset, "scene": 0, "scenes": [{}] });
        }
        let mut surface = json!({ "metallicFactor": 0.0, "roughnessFactor": 1.0 });
        if self.textured {
            surface["baseColorTexture"] = json!({ "index": 0 });
        }
        let material = json!({ "pbrMetallicRoughness": surface, "extensions": { UNLIT: {} } });
        let indices = self.accessors.len() - 1;
        let primitive = json!({ "attributes": self.attributes, "indices": indices, "material": 0, "mode": 4 });
        let mut document = json!({
            "asset": asset,
            "extensionsUsed": [UNLIT],
            "scene": 0,
            "scenes": [{ "nodes": [0] }],
            "nodes": [{ "mesh": 0 }],
            "meshes": [{ "primitives": [primitive] }],
            "materials": [material],
            "accessors": self.accessors,
            "bufferViews": self.views,
            "buffers": [{ "byteLength": self.binary.len() }],
        });
        if self.textured {
            document["images"] = json!([{ "bufferView": self.views.len() - 1, "mimeType": "image/jpeg" }]);
            document["textures"] = json!([{ "source": 0 }]);
        }
        document
    }
}

/// A point with +y up: half a turn about z, as Gaussians are turned.
fn turned([x, y, z]: [f32; 3]) -> [f32; 3] {
    [-x, -y, z]
}

/// A value of sRGB as a share of the light, in 65535ths.
fn linear(value: u8) -> u16 {
    let x = f64::from(value) / 255.0;
    let light = if x <= 0.04045 { x / 12.92 } else { ((x + 0.055) / 1.055).powf(2.4) };
    (light * f64::from(u16::MAX)).round() as u16
}
