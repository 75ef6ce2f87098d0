//! The parts of a glTF document that scenes of Gaussians are made of.

use super::{BINARY, JSON, MAGIC};
use crate::files::bytes::Bytes;
use crate::files::content::Content;
use crate::files::json::not_json;
use crate::{Error, Result};
use serde::Deserialize;
use std::collections::BTreeMap;
use std::ops::Range;
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
    #[serde(default = "perspective")]
    pub projection: Option<String>,
    #[serde(default = "camera_distance")]
    pub sorting_method: Option<String>,
    #[serde(default)]
    pub extensions: Compressions,
}

#[derive(Default, Deserialize)]
#[serde(default)]
pub(super) struct Compressions {
    #[serde(rename = "KHR_gaussian_splatting_compression_spz_2")]
    pub spz: Option<Packed>,
}

/// Gaussians in an SPZ file.
#[derive(Deserialize)]
#[serde(rename_all = "camelCase")]
pub(super) struct Packed {
    pub buffer_view: usize,
}

fn perspective() -> Option<String> {
    Some("perspective".into())
}

fn camera_distance() -> Option<String> {
    Some("cameraDistance".into())
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
    /// The document of a file, and where the binary chunk lies of one that has chunks.
    pub(super) fn read(path: &Path, file: &Content<'_>) -> Result<(Self, Option<Range<usize>>)> {
        let in_chunks = file.part(0..file.len().min(MAGIC.len()))?.starts_with(MAGIC);
        let (json, binary) = if in_chunks { chunks(path, file)? } else { (0..file.len(), None) };
        let text = file.part(json)?;
        let document = serde_json::from_slice(&text).map_err(|e| {
            let place = format!("line {} column {}", e.line(), e.column());
            Error::invalid(path, place, "a glTF document", not_json(&e, &text))
        })?;
        Ok((document, binary))
    }
}

/// Bytes of the header of a file of chunks.
const HEADER: usize = 12;
/// Bytes of the header of a chunk.
const CHUNK: usize = 8;

/// The places of the document, which comes first, and of the binary chunk, if that follows.
fn chunks(path: &Path, file: &Content<'_>) -> Result<(Range<usize>, Option<Range<usize>>)> {
    let header = file.part(0..file.len().min(HEADER))?;
    let mut bytes = Bytes::new(path, &*header);
    bytes.skip(MAGIC.len(), "a header")?;
    let version = bytes.u32("a version")?;
    if version != 2 {
        return Err(bytes.invalid("version 2", version));
    }
    let length = bytes.u32("a length")? as usize;
    if length > file.len() {
        return Err(bytes.invalid(format!("at most {} bytes", file.len()), length));
    }
    let (json, kind) = chunk(path, file, HEADER)?;
    if kind != JSON {
        return Err(Error::invalid(path, "chunks", "one of JSON first", format!("{kind:08x}")));
    }
    let second = if json.end < file.len() { Some(chunk(path, file, json.end)?) } else { None };
    Ok((json, second.filter(|(_, kind)| *kind == BINARY).map(|(place, _)| place)))
}

/// The place of a chunk that begins somewhere, and its kind.
fn chunk(path: &Path, file: &Content<'_>, at: usize) -> Result<(Range<usize>, u32)> {
    let header = file.part(at..file.len().min(at + CHUNK))?;
    let mut bytes = Bytes::new(path, &*header);
    let (length, kind) = (bytes.u32("a chunk")? as usize, bytes.u32("a chunk")?);
    let (start, room) = (at + CHUNK, file.len() - at - CHUNK);
    if length > room {
        let expected = format!("{length} bytes of a chunk");
        return Err(Error::invalid(path, format!("byte {start}"), expected, format!("{room} until the end")));
    }
    Ok((start..start + length, kind))
}
