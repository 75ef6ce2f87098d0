//! Files that grow: logs of a run.

use crate::{Error, Result, atomic_write};
use std::fs::{File, OpenOptions};
use std::io::Write;
use std::path::{Path, PathBuf};

/// A file that is appended to, record by record; what was written stays if the process dies.
#[derive(Debug)]
pub struct Appender {
    path: PathBuf,
    file: File,
}

impl Appender {
    /// Opens a file at its end; creates it when it does not exist.
    ///
    /// # Errors
    /// When the file cannot be opened for writing.
    pub fn open(path: impl AsRef<Path>) -> Result<Self> {
        let path = path.as_ref().to_path_buf();
        let file = OpenOptions::new().create(true).append(true).open(&path).map_err(Error::io(&path))?;
        Ok(Self { path, file })
    }

    /// Appends one record in a single write.
    ///
    /// # Errors
    /// When the disk is full or the file has gone.
    pub fn append(&mut self, record: &[u8]) -> Result<()> {
        self.file.write_all(record).map_err(Error::io(&self.path))
    }
}

/// The whole of a file.
///
/// # Errors
/// When it cannot be read.
pub fn read_bytes(path: impl AsRef<Path>) -> Result<Vec<u8>> {
    crate::error::read_bytes(path.as_ref())
}

/// The text of a file.
///
/// # Errors
/// When it cannot be read or is not UTF-8.
pub fn read_text(path: impl AsRef<Path>) -> Result<String> {
    crate::error::read_text(path.as_ref())
}

/// Writes a text file atomically.
///
/// # Errors
/// When it cannot be written; an old file is then left as it was.
pub fn write_text(path: impl AsRef<Path>, text: &str) -> Result<()> {
    atomic_write(path, |w| w.write_all(text.as_bytes()))
}

/// Creates a folder and its parents.
///
/// # Errors
/// When it cannot be created.
pub fn create_folder(path: impl AsRef<Path>) -> Result<()> {
    let path = path.as_ref();
    std::fs::create_dir_all(path).map_err(Error::io(path))
}
