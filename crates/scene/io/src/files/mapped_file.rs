//! Memory-mapped files: the system loads pages when they are read and may drop them again.

use crate::{Error, Result};
use memmap2::{Mmap, MmapMut, MmapOptions};
use std::fs::File;
use std::ops::Deref;
use std::path::{Path, PathBuf};

/// A file that is mapped into memory, read-only. All `unsafe` of this crate is here.
#[derive(Debug)]
pub struct MappedFile {
    map: Mmap,
    path: PathBuf,
}

impl MappedFile {
    /// Maps a file.
    ///
    /// # Errors
    /// When it cannot be read or is not a regular file: to open a pipe would wait for whoever writes into it.
    pub fn open(path: &Path) -> Result<Self> {
        if !path.metadata().map_err(Error::io(path))?.is_file() {
            return Err(Error::invalid(path, "file", "a regular file", "another kind"));
        }
        let file = File::open(path).map_err(Error::io(path))?;
        // SAFETY: the map is private to this process and never written through. Another process that changes the file
        // meanwhile is invisible to the type system: bytes would then differ between two reads, or be gone where the
        // file was cut. Every value of a byte is a valid number, lengths are checked against the map's own length, and
        // a checkpoint that is being written does not yet have its name (all writers here rename at the end).
        #[allow(unsafe_code)]
        let map = unsafe { Mmap::map(&file) }.map_err(Error::io(path))?;
        Ok(Self { map, path: path.to_path_buf() })
    }

    /// Maps a part of an open file that no one writes to again; errors call it by this path.
    pub fn part_of(file: &File, path: &Path, [offset, len]: [u64; 2]) -> Result<Self> {
        let len =
            usize::try_from(len).map_err(|_| Error::invalid(path, "bytes", "a part that fits into memory", len))?;
        // SAFETY: as in `open`. The files that are mapped in parts have no name: no other process knows them.
        #[allow(unsafe_code)]
        let map = unsafe { MmapOptions::new().offset(offset).len(len).map(file) }.map_err(Error::io(path))?;
        Ok(Self { map, path: path.to_path_buf() })
    }

    /// Bytes in memory in place of a file's; errors call them by this path.
    pub fn of_bytes(path: &Path, bytes: &[u8]) -> Result<Self> {
        let mut map = MmapMut::map_anon(bytes.len()).map_err(Error::io(path))?;
        map.copy_from_slice(bytes);
        Ok(Self { map: map.make_read_only().map_err(Error::io(path))?, path: path.to_path_buf() })
    }

    /// Drops the pages read so far; they are loaded from the file again when needed. Does nothing where the system has
    /// no such request.
    pub fn forget(&self) {
        // SAFETY: a private map that nobody writes to has nothing but the file's bytes, so that a page that comes back
        // is the page that went; the reservation above about a file that changes meanwhile holds here as well.
        #[cfg(unix)]
        #[allow(unsafe_code)]
        let _ = unsafe { self.map.unchecked_advise(memmap2::UncheckedAdvice::DontNeed) };
    }

    /// The path of the file.
    pub fn path(&self) -> &Path {
        &self.path
    }
}

impl Deref for MappedFile {
    type Target = [u8];
    fn deref(&self) -> &[u8] {
        &self.map
    }
}
