//! Files that grow: logs of a run.

use crate::{Error, Result};
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
