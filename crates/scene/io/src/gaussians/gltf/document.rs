//! The parts of a glTF document that scenes of Gaussians are made of.

use super::{BINARY, JSON, MAGIC};
use crate::files::bytes::Bytes;
use crate::files::json::not_json;
use crate::{Error, Result};
use serde::Deserialize;
use std::collections::BTreeMap;
use std::path::Path;

#[derive(Default, Deserialize)]
#[serde(default, rename_all = "camelCase")]
pub(super) struct Document {
    pub extensions_used: Vec<String>,
    pub extensions_required: Vec<String>,
    pub scene: Option<usize>,
    pub scenes: Vec<Scene>,
    pub nodes: Vec<Node>,
    pub meshes: Vec<Mesh>,
    pub accessors: Vec<Accessor>,
    pub buffer_views: Vec<BufferView>,
    pub buffers: Vec<Buffer>,
}

#[derive(Default, Deserialize)]
#[serde(default)]
pub(super) struct Scene {
    pub nodes: Vec<usize>,
}

#[derive(Default, Deserialize)]
#[serde(default)]
pub(super) struct Node {
    pub mesh: Option<usize>,
    pub children: Vec<usize>,
    /// Column by column.
    pub matrix: Option<[f64; 16]>,
    pub translation: Option<[f64; 3]>,
    /// xyzw.
    pub rotation: Option<[f64; 4]>,
    pub scale: Option<[f64; 3]>,
}

#[derive(Deserialize)]
pub(super) struct Mesh {
    pub primitives: Vec<Primitive>,
}

#[derive(Deserialize)]
pub(super) struct Primitive {
    pub attributes: BTreeMap<String, usize>,
    /// 0 for points.
    pub mode: Option<u64>,
    #[serde(default)]
    pub extensions: Extensions,
}

#[derive(Default, Deserialize)]
#[serde(default)]
pub(super) struct Extensions {
    #[serde(rename = "KHR_gaussian_splatting")]
    pub splatting: Option<Splatting>,
}

#[derive(Deserialize)]
#[serde(rename_all = "camelCase")]
pub(super) struct Splatting {
    pub kernel: Option<String>,
    pub color_space: Option<String>,
}

#[derive(Deserialize)]
#[serde(rename_all = "camelCase")]
pub(super) struct Accessor {
    pub buffer_view: Option<usize>,
    #[serde(default)]
    pub byte_offset: usize,
    pub component_type: u64,
    #[serde(default)]
    pub normalized: bool,
    pub count: usize,
    #[serde(rename = "type")]
    pub kind: String,
    pub sparse: Option<Sparse>,
}

/// Elements that replace others.
#[derive(Deserialize)]
pub(super) struct Sparse {
    pub count: usize,
    pub indices: SparsePart,
    pub values: SparsePart,
}

#[derive(Deserialize)]
#[serde(rename_all = "camelCase")]
pub(super) struct SparsePart {
    pub buffer_view: usize,
    #[serde(default)]
    pub byte_offset: usize,
    /// Of indices alone.
    pub component_type: Option<u64>,
}

#[derive(Deserialize)]
#[serde(rename_all = "camelCase")]
pub(super) struct BufferView {
    pub buffer: usize,
    #[serde(default)]
    pub byte_offset: usize,
    pub byte_length: usize,
    pub byte_stride: Option<usize>,
}

#[derive(Deserialize)]
#[serde(rename_all = "camelCase")]
pub(super) struct Buffer {
    pub uri: Option<String>,
    pub byte_length: usize,
}

impl Document {
    /// The document of a file, and the binary chunk of one that has chunks.
    pub(super) fn read<'a>(path: &Path, data: &'a [u8]) -> Result<(Self, Option<&'a [u8]>)> {
        let (json, binary) = if data.starts_with(MAGIC) { chunks(path, data)? } else { (data, None) };
        let document = serde_json::from_slice(json).map_err(|e| {
            let place = format!("line {} column {}", e.line(), e.column());
            Error::invalid(path, place, "a glTF document", not_json(&e))
        })?;
        Ok((document, binary))
    }
}

/// The document and the binary chunk.
fn chunks<'a>(path: &Path, data: &'a [u8]) -> Result<(&'a [u8], Option<&'a [u8]>)> {
    let mut bytes = Bytes::new(path, data);
    bytes.skip(MAGIC.len(), "a header")?;
    let version = bytes.u32("a version")?;
    if version != 2 {
        return Err(bytes.invalid("version 2", version));
    }
    let length = bytes.u32("a length")? as usize;
    if length > data.len() {
        return Err(bytes.invalid(format!("at most {} bytes", data.len()), length));
    }
    let (mut json, mut binary) = (None, None);
    while !bytes.rest().is_empty() {
        let (length, kind) = (bytes.u32("a chunk")? as usize, bytes.u32("a chunk")?);
        let start = data.len() - bytes.rest().len();
        bytes.skip(length, "a chunk")?;
        let chunk = &data[start..start + length];
        match kind {
            JSON if json.is_none() => json = Some(chunk),
            BINARY if binary.is_none() => binary = Some(chunk),
            _ => {}
        }
    }
    Ok((json.ok_or_else(|| Error::invalid(path, "chunks", "one of JSON", "none"))?, binary))
}
