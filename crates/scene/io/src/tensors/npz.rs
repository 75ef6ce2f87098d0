//! NumPy's archives of arrays.

use super::npy::Npy;
use crate::files::file::read_bytes;
use crate::files::mapped_file::MappedFile;
use crate::{Error, Result};
use flate2::read::DeflateDecoder;
use std::io::{Cursor, Read};
use std::path::{Path, PathBuf};
use zip::{CompressionMethod, ZipArchive};

/// Bytes of an array at most, so that no archive requests more memory than there is.
const LARGEST: u64 = 1 << 30;

/// An `.npz` file: arrays by name, stored or deflated, as `numpy.savez` and `numpy.savez_compressed` write them.
///
/// ```no_run
/// let arrays = weaver_io::Npz::open("cameras.npz")?;
/// assert_eq!(arrays.array("world_mat_0")?.shape(), [4, 4]);
/// # Ok::<(), weaver_io::Error>(())
/// ```
#[derive(Clone, Debug)]
pub struct Npz {
    path: PathBuf,
    zip: ZipArchive<Cursor<Vec<u8>>>,
}

impl Npz {
    /// Opens an archive.
    ///
    /// # Errors
    /// When it cannot be read, or is no ZIP archive.
    pub fn open(path: impl AsRef<Path>) -> Result<Self> {
        let path = path.as_ref().to_path_buf();
        let zip = ZipArchive::new(Cursor::new(read_bytes(&path)?));
        let zip = zip.map_err(|error| Error::invalid(&path, "content", "a ZIP archive of arrays", error))?;
        Ok(Self { path, zip })
    }

    /// Names of its arrays, sorted.
    pub fn names(&self) -> Vec<String> {
        let mut names: Vec<String> =
            self.zip.file_names().filter_map(|name| Some(name.strip_suffix(".npy")?.into())).collect();
        names.sort_unstable();
        names
    }

    /// The array of a name.
    ///
    /// # Errors
    /// When there is none, it cannot be unpacked, or is not of numbers that [`Npy`] reads.
    pub fn array(&self, name: &str) -> Result<Npy> {
        let invalid = |expected: &str, found: String| Error::invalid(&self.path, name, expected, found);
        let mut zip = self.zip.clone();
        let index = zip.index_for_name(&format!("{name}.npy"));
        let index =
            index.ok_or_else(|| invalid("an array of this name", format!("only {}", self.names().join(", "))))?;
        let mut entry =
            zip.by_index_raw(index).map_err(|error| invalid("an array in the archive", error.to_string()))?;
        let (method, size) = (entry.compression(), entry.size());
        if size > LARGEST {
            return Err(invalid(&format!("at most {LARGEST} bytes"), size.to_string()));
        }
        let mut bytes = Vec::new();
        let read = match method {
            CompressionMethod::Stored => entry.by_ref().take(size).read_to_end(&mut bytes),
            CompressionMethod::DEFLATE => DeflateDecoder::new(&mut entry).take(size).read_to_end(&mut bytes),
            other => return Err(invalid("an array that is stored or deflated", other.to_string())),
        };
        read.map_err(|error| invalid("an array that can be unpacked", error.to_string()))?;
        Npy::of(MappedFile::of_bytes(&self.path.join(name), &bytes)?)
    }
}
