//! glTF 2.0 with the extension KHR_gaussian_splatting: `.glb`, and `.gltf` with buffers inside or beside it.
//!
//! A primitive of points has positions, rotations (xyzw), standard deviations, opacities and coefficients of harmonics
//! as attributes. glTF's up is +y and captures' is -y, so that reading and writing turn everything by half a turn about
//! z: x and y are negated, and with them coefficients whose order m is odd.
//!
//! Source: github.com/KhronosGroup/glTF, extensions/2.0/Khronos/KHR_gaussian_splatting.

mod accessors;
mod buffers;
mod decode;
mod document;
mod encode;
mod nodes;

use super::blocks::Blocks;
use super::scene_file::{Drawing, OpenScene};
use crate::files::content::Content;
use crate::{Error, Result};
use std::io::Write;
use std::path::Path;
use weaver_geometry::sh;

/// The extension.
const EXTENSION: &str = "KHR_gaussian_splatting";
/// The draft of an extension of it, of Gaussians that are packed as an SPZ file; read and not written.
const PACKED: &str = "KHR_gaussian_splatting_compression_spz_2";
const MAGIC: &[u8; 4] = b"glTF";
const JSON: u32 = u32::from_le_bytes(*b"JSON");
const BINARY: u32 = u32::from_le_bytes(*b"BIN\0");

/// Opens a `.glb` or `.gltf` file: the Gaussians of all nodes of its scene, with the nodes' transforms applied. Its
/// buffers are read on demand; base64 and files with sparse accessors are read at once.
///
/// # Errors
/// When it is malformed, an accessor leads out of its buffer, a transform is no similarity, or the file requires an
/// extension that is unknown here.
pub(crate) fn open<'a>(path: &Path, content: Content<'a>) -> Result<OpenScene<'a>> {
    Ok(OpenScene { gaussians: decode::open(path, content)?, drawing: Drawing::default() })
}

/// Writes a `.glb` file; every number is a 32-bit float.
///
/// Viewers without the extension show points in the colors of `COLOR_0`.
///
/// # Errors
/// When a value is not finite, or the file would have more than 4 GB.
pub(crate) fn encode_glb(path: &Path, gaussians: &dyn Blocks, _drawing: Drawing, w: &mut dyn Write) -> Result<()> {
    encode::glb(path, gaussians, w)
}

/// Writes a `.gltf` file with its buffer inside, in base64.
///
/// # Errors
/// When a value is not finite.
pub(crate) fn encode_gltf(path: &Path, gaussians: &dyn Blocks, _drawing: Drawing, w: &mut dyn Write) -> Result<()> {
    encode::gltf(path, gaussians, w)
}

/// Attributes of a degree of harmonics.
fn harmonics(degree: usize) -> impl Iterator<Item = String> {
    (0..=2 * degree).map(move |n| format!("{EXTENSION}:SH_DEGREE_{degree}_COEF_{n}"))
}

/// Signs of coefficients after half a turn about z.
fn signs() -> [f32; sh::MAX_COEFFICIENTS] {
    sh::half_turn_signs(2)
}

/// Malformed content of this file.
fn invalid<'a>(path: &'a Path, place: &'a str, expected: &'a str) -> impl Fn(String) -> Error + 'a {
    move |found| Error::invalid(path, place, expected, found)
}
