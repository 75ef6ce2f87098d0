//! The files of a scene: of an archive in memory, or of a folder.

use super::META;
use super::streamed::is_inside;
use crate::files::file::read_bytes;
use crate::{Error, Result};
use flate2::read::DeflateDecoder;
use std::io::{Cursor, Read};
use std::path::{Path, PathBuf};
use zip::{CompressionMethod, ZipArchive};

/// Deflate makes no file more than about 1032 times smaller.
const LARGEST_RATIO: u64 = 1040;
/// The largest `meta.json`: its tables have a few hundred numbers.
const LARGEST_META: u64 = 1 << 20;

/// A ZIP archive whose files are stored as they are, or deflated.
pub(super) struct Archive<'a> {
    path: &'a Path,
    zip: ZipArchive<Cursor<&'a [u8]>>,
    /// The folder in the archive, with a slash at its end.
    folder: String,
    /// Bytes that may still be unpacked.
    left: u64,
}

impl<'a> Archive<'a> {
    pub(super) fn open(path: &'a Path, data: &'a [u8]) -> Result<Self> {
        let zip = ZipArchive::new(Cursor::new(data));
        let zip = zip.map_err(|e| Error::invalid(path, "content", "a ZIP archive", e))?;
        let meta = zip.file_names().filter(|name| name.rsplit('/').next() == Some(META)).min_by_key(|name| name.len());
        let Some(folder) = meta.map(|name| name.trim_end_matches(META).to_string()) else {
            return Err(Error::invalid(path, "archive", META, "other files"));
        };
        Ok(Self { path, zip, folder, left: data.len() as u64 + LARGEST_META })
    }

    pub(super) fn meta(&mut self) -> Result<Vec<u8>> {
        let meta = self.file(META)?;
        if meta.len() as u64 > LARGEST_META {
            return Err(Error::invalid(self.path, META, format!("at most {LARGEST_META} bytes"), meta.len()));
        }
        Ok(meta)
    }

    pub(super) fn file(&mut self, name: &str) -> Result<Vec<u8>> {
        let (path, left) = (self.path, self.left);
        let invalid = |expected: &str, found: String| Error::invalid(path, name, expected, found);
        let index = self.zip.index_for_name(&format!("{}{name}", self.folder));
        let index = index.ok_or_else(|| invalid("a file of this name in the archive", "none".into()))?;
        let mut entry = self.zip.by_index_raw(index).map_err(|e| invalid("a file in the archive", e.to_string()))?;
        let (method, size) = (entry.compression(), entry.size());
        // Pictures do not get smaller by deflating, so that all files together are about as long as the archive.
        if size > left || size > entry.compressed_size().saturating_mul(LARGEST_RATIO) {
            return Err(invalid(&format!("at most {left} bytes"), size.to_string()));
        }
        let mut content = Vec::new();
        let read = match method {
            CompressionMethod::Stored => entry.by_ref().take(size).read_to_end(&mut content),
            CompressionMethod::DEFLATE => DeflateDecoder::new(&mut entry).take(size).read_to_end(&mut content),
            other => return Err(invalid("a file that is stored or deflated", other.to_string())),
        };
        read.map_err(|e| invalid("a file in the archive", e.to_string()))?;
        self.left -= content.len() as u64;
        Ok(content)
    }
}

/// The folder of a `meta.json`.
pub(super) struct Folder {
    meta: PathBuf,
}

impl Folder {
    pub(super) fn beside(meta: &Path) -> Self {
        Self { meta: meta.to_path_buf() }
    }

    /// A file of the folder itself.
    pub(super) fn file(&self, name: &str) -> Result<Vec<u8>> {
        if name.contains(['/', '\\']) { Err(self.leads_out(name)) } else { self.file_within(name) }
    }

    /// A file of the folder, or of one in it.
    pub(super) fn file_within(&self, name: &str) -> Result<Vec<u8>> {
        if is_inside(name) { read_bytes(self.meta.with_file_name(name)) } else { Err(self.leads_out(name)) }
    }

    /// A file of others must not lead out of its folder.
    fn leads_out(&self, name: &str) -> Error {
        Error::invalid(&self.meta, "files", "names of files in this folder", format!("{name:?}"))
    }
}
