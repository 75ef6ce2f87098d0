//! Files that grow, such as the logs of a run.

use crate::{Error, Result};
use std::fs::{File, OpenOptions};
use std::io::Write;
use std::path::{Path, PathBuf};

/// A file to which records are appended; written records survive the end of the process.
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
    /// When the file cannot be written, for instance because the disk is full.
    pub fn append(&mut self, record: &[u8]) -> Result<()> {
        self.file.write_all(record).map_err(Error::io(&self.path))
    }
}
