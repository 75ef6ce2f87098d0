//! SOG, version 2: Gaussians as pixels of lossless WebP pictures, beside a `meta.json` or in one ZIP archive with it;
//! and [streamed SOG](streamed), many of these in levels of detail.
//!
//! Pixel i of each picture belongs to Gaussian i. A position has 16 bits per coordinate between bounds of `sign(x)
//! ln(1 + |x|)`, a rotation three components of 8 bits, scales and colors are entries of tables of 256 numbers, and
//! the harmonics of a Gaussian are one row of a palette.
//!
//! Source: developer.playcanvas.com/user-manual/gaussian-splatting/formats/sog.

mod codebook;
mod decode;
mod encode;
mod files;
mod meta;
mod palette;
mod plane;
mod replaced;
mod streamed;

use super::scene_file::{Drawing, SceneFile};
use crate::files::file::read_bytes;
use crate::{Error, Result};
use decode::decoded;
pub(super) use encode::File;
use encode::encoded;
use files::{Archive, Folder};
use meta::Meta;
pub(super) use replaced::write as write_files;
use std::io::{Cursor, Write};
use std::path::Path;
pub(crate) use streamed::LOD_META;
use weaver_scene::Gaussians;
use zip::write::SimpleFileOptions;
use zip::{CompressionMethod, ZipWriter};

/// The file that names the others.
pub(crate) const META: &str = "meta.json";

/// Reads a `.sog` archive.
///
/// # Errors
/// When it is no such archive, a file in it is missing or malformed, or a number leads beyond a table.
pub(crate) fn decode(path: &Path, data: &[u8]) -> Result<SceneFile> {
    let mut archive = Archive::open(path, data)?;
    let meta = archive.meta()?;
    decoded(path, &meta, &mut |name| archive.file(name))
}

/// Reads a `meta.json` and the pictures beside it.
///
/// # Errors
/// As [`decode`].
pub(crate) fn decode_folder(path: &Path, data: &[u8]) -> Result<SceneFile> {
    let folder = Folder::beside(path);
    decoded(path, data, &mut |name| folder.file(name))
}

/// Reads the finest level of a `lod-meta.json` and the folders beside it.
///
/// # Errors
/// As [`decode`].
pub(crate) fn decode_streamed(path: &Path, data: &[u8]) -> Result<SceneFile> {
    let folder = Folder::beside(path);
    streamed::decoded_finest(path, data, &mut |name| folder.file_within(name))
}

/// The numbers of Gaussians in the order in which [`encode_streamed`] writes the finest level.
pub(super) fn streamed_order(gaussians: &Gaussians) -> Vec<usize> {
    streamed::order(gaussians)
}

/// Names of the files of a scene in a folder, its `meta.json` or `lod-meta.json` among them.
///
/// # Errors
/// When one of these cannot be read or is malformed.
pub(crate) fn names(path: &Path) -> Result<Vec<String>> {
    let data = read_bytes(path)?;
    if is_streamed(path) {
        let folder = Folder::beside(path);
        return streamed::names(path, &data, &mut |name| folder.file_within(name));
    }
    Ok(Meta::read(path, &data)?.files().chain([META.to_string()]).collect())
}

/// True of a scene in levels, by the name of its first file.
fn is_streamed(path: &Path) -> bool {
    path.file_name().is_some_and(|name| name.eq_ignore_ascii_case(LOD_META))
}

/// Writes a `.sog` archive.
///
/// Gaussians are written in the order of a curve through space, which makes smaller pictures. The tables and the
/// palette come from clustering: equal Gaussians give equal files.
///
/// # Errors
/// When a value is not finite.
pub(crate) fn encode(path: &Path, gaussians: &Gaussians, drawing: Drawing, w: &mut dyn Write) -> Result<()> {
    let invalid = |e: zip::result::ZipError| Error::io(path)(e.into());
    let mut zip = ZipWriter::new(Cursor::new(Vec::new()));
    // Pictures are compressed already.
    let stored = SimpleFileOptions::default().compression_method(CompressionMethod::Stored);
    for File { name, content } in encoded(path, gaussians, drawing)? {
        zip.start_file(name, stored).map_err(invalid)?;
        zip.write_all(&content).map_err(Error::io(path))?;
    }
    let archive = zip.finish().map_err(invalid)?;
    w.write_all(archive.get_ref()).map_err(Error::io(path))
}

/// The files of a scene in a folder: a `meta.json` and the pictures beside it.
///
/// # Errors
/// As [`encode`].
pub(super) fn encode_folder(path: &Path, gaussians: &Gaussians, drawing: Drawing) -> Result<Vec<File>> {
    encoded(path, gaussians, drawing)
}

/// The files of a scene in levels of detail: a `lod-meta.json`, and folders of SOG beside it.
///
/// # Errors
/// As [`encode`].
pub(super) fn encode_streamed(path: &Path, gaussians: &Gaussians, drawing: Drawing) -> Result<Vec<File>> {
    streamed::encoded(path, gaussians, drawing)
}

/// The scene of files that are still in memory.
///
/// # Errors
/// As [`decode`].
pub(super) fn decode_files(path: &Path, files: &[File]) -> Result<SceneFile> {
    let content = |name: &str| files.iter().find(|file| file.name == name).map(|file| file.content.clone());
    let file = |name: &str| content(name).ok_or_else(|| Error::invalid(path, "files", name, "none of that name"));
    if is_streamed(path) {
        return streamed::decoded_finest(path, &file(LOD_META)?, &mut |name| file(name));
    }
    decoded(path, &file(META)?, &mut |name| file(name))
}
