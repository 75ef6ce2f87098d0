//! Bytes of a file, a part at a time.

use crate::files::file::{read_bytes, read_part};
use crate::{Error, Result};
use std::borrow::Cow;
use std::ops::Range;
use std::path::{Path, PathBuf};

/// A file that is in memory, or whose parts are read on demand.
pub(crate) enum Content<'a> {
    Memory(Cow<'a, [u8]>),
    Disk { path: PathBuf, length: usize },
}

impl Content<'static> {
    /// A file on disk; a file without a length, such as a pipe, is read whole.
    pub(crate) fn open(path: &Path) -> Result<Self> {
        let about = std::fs::metadata(path).map_err(Error::io(path))?;
        let length = usize::try_from(about.len()).ok().filter(|_| about.is_file());
        Ok(match length {
            Some(length) => Self::Disk { path: path.to_path_buf(), length },
            None => Self::Memory(read_bytes(path)?.into()),
        })
    }
}

impl Content<'_> {
    /// Number of bytes.
    pub(crate) fn len(&self) -> usize {
        match self {
            Self::Memory(bytes) => bytes.len(),
            Self::Disk { length, .. } => *length,
        }
    }

    /// Bytes that lie within [`len`](Self::len).
    pub(crate) fn part(&self, part: Range<usize>) -> Result<Cow<'_, [u8]>> {
        match self {
            Self::Memory(bytes) => Ok((&bytes[part]).into()),
            Self::Disk { path, .. } => Ok(read_part(path, part.start as u64..part.end as u64)?.into()),
        }
    }

    /// All bytes.
    pub(crate) fn all(&self) -> Result<Cow<'_, [u8]>> {
        self.part(0..self.len())
    }
}
