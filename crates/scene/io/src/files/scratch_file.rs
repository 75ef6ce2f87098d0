//! A file for bytes that memory has no room for.

use super::mapped_file::MappedFile;
use crate::{Error, Result};
use std::fs::File;
use std::io::{Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};
use weaver_scene::{KeptBytes, Pixels};

/// A file without a name that keeps pictures out of memory: the system loads their pages when they are read, and drops
/// them when it needs room. It ends with the last picture in it.
///
/// ```
/// let scratch = weaver_io::ScratchFile::new(&std::env::temp_dir())?;
/// let pixels = scratch.keep(&[1, 2, 3])?;
/// assert_eq!(pixels[..], [1, 2, 3]);
/// assert_eq!(pixels.beside(vec![4])[..], [4]);
/// # Ok::<_, weaver_io::Error>(())
/// ```
#[derive(Clone, Debug)]
pub struct ScratchFile {
    file: Arc<Mutex<File>>,
    folder: PathBuf,
}

impl ScratchFile {
    /// An empty file on the file system of a folder.
    ///
    /// # Errors
    /// When no file can be made there.
    pub fn new(folder: &Path) -> Result<Self> {
        let file = tempfile::tempfile_in(folder).map_err(Error::io(folder))?;
        Ok(Self { file: Arc::new(Mutex::new(file)), folder: folder.into() })
    }

    /// Writes bytes to the end of the file and gives them back from there.
    ///
    /// # Errors
    /// When the file system has no room for them.
    pub fn keep(&self, bytes: &[u8]) -> Result<Pixels> {
        Ok(Pixels::Kept(Arc::new(self.write(bytes)?)))
    }

    fn write(&self, bytes: &[u8]) -> Result<Part> {
        // Each part begins at the end, so that nobody writes where another one is mapped.
        let mut file = self.file.lock().unwrap_or_else(PoisonError::into_inner);
        let offset = file.seek(SeekFrom::End(0)).map_err(Error::io(&self.folder))?;
        file.write_all(bytes).map_err(Error::io(&self.folder))?;
        let map = MappedFile::part_of(&file, &self.folder, [offset, bytes.len() as u64])?;
        Ok(Part { map, of: self.clone() })
    }
}

/// Bytes in a scratch file.
#[derive(Debug)]
struct Part {
    map: MappedFile,
    of: ScratchFile,
}

impl AsRef<[u8]> for Part {
    fn as_ref(&self) -> &[u8] {
        &self.map
    }
}

impl KeptBytes for Part {
    fn beside(&self, bytes: &[u8]) -> Option<Arc<dyn KeptBytes>> {
        let part = self.of.write(bytes).ok()?;
        Some(Arc::new(part))
    }
}
