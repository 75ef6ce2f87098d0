//! Little-endian binary records, read with bounds checks.

use crate::{Error, Result};
use std::borrow::Cow;
use std::path::{Path, PathBuf};

/// A file in memory and a position in it.
pub(crate) struct Bytes<'a> {
    path: PathBuf,
    data: Cow<'a, [u8]>,
    at: usize,
}

impl<'a> Bytes<'a> {
    /// `data` that was in the file, perhaps compressed.
    pub(crate) fn new(path: &Path, data: impl Into<Cow<'a, [u8]>>) -> Self {
        Self { path: path.to_path_buf(), data: data.into(), at: 0 }
    }

    /// The unread bytes.
    pub(crate) fn rest(&self) -> &[u8] {
        &self.data[self.at..]
    }

    /// The next `N` bytes, which are (part of) `what`.
    pub(crate) fn take<const N: usize>(&mut self, what: &str) -> Result<[u8; N]> {
        match self.rest().first_chunk() {
            Some(&chunk) => {
                self.at += N;
                Ok(chunk)
            }
            None => Err(self.invalid(format!("{N} bytes of {what}"), format!("{} until the end", self.rest().len()))),
        }
    }

    /// Leaves out bytes, which are (part of) `what`.
    pub(crate) fn skip(&mut self, length: usize, what: &str) -> Result<()> {
        if length > self.rest().len() {
            let found = format!("{} until the end", self.rest().len());
            return Err(self.invalid(format!("{length} bytes of {what}"), found));
        }
        self.at += length;
        Ok(())
    }

    pub(crate) fn u32(&mut self, what: &str) -> Result<u32> {
        Ok(u32::from_le_bytes(self.take(what)?))
    }

    pub(crate) fn u64(&mut self, what: &str) -> Result<u64> {
        Ok(u64::from_le_bytes(self.take(what)?))
    }

    pub(crate) fn f64(&mut self, what: &str) -> Result<f64> {
        Ok(f64::from_le_bytes(self.take(what)?))
    }

    pub(crate) fn f64s<const N: usize>(&mut self, what: &str) -> Result<[f64; N]> {
        let mut values = [0.0; N];
        for value in &mut values {
            *value = self.f64(what)?;
        }
        Ok(values)
    }

    pub(crate) fn f32s<const N: usize>(&mut self, what: &str) -> Result<[f32; N]> {
        let mut values = [0.0; N];
        for value in &mut values {
            *value = f32::from_le_bytes(self.take(what)?);
        }
        Ok(values)
    }

    /// A number of records of at least `record` bytes each, which must fit in the rest of the file: a reader reserves
    /// no more memory for them than a constant times the file's length.
    pub(crate) fn count(&mut self, record: usize, what: &str) -> Result<usize> {
        let count = self.u64(what)?;
        let room = self.rest().len() / record;
        if count > room as u64 {
            self.at -= 8;
            return Err(self.invalid(format!("at most {room} {what} in what is left of the file"), count));
        }
        Ok(count as usize)
    }

    /// Text up to a zero byte.
    pub(crate) fn text(&mut self, what: &str) -> Result<String> {
        let Some(length) = self.rest().iter().position(|&b| b == 0) else {
            return Err(self.invalid(format!("{what} ended by a zero byte"), "the end of the file"));
        };
        let text = match std::str::from_utf8(&self.rest()[..length]) {
            Ok(text) => text.to_string(),
            Err(_) => return Err(self.invalid(format!("{what} in UTF-8"), "other bytes")),
        };
        self.at += length + 1;
        Ok(text)
    }

    /// Errors when bytes are left.
    pub(crate) fn finish(&self) -> Result<()> {
        match self.rest().len() {
            0 => Ok(()),
            n => Err(self.invalid("the end of the file", format!("{n} more bytes"))),
        }
    }

    /// Content at the present position that is not as it should be.
    pub(crate) fn invalid(&self, expected: impl std::fmt::Display, found: impl std::fmt::Display) -> Error {
        Error::invalid(&self.path, format!("byte {}", self.at), expected, found)
    }
}
