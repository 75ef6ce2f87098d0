//! Whole files.

use crate::{Error, Result, atomic_write};
use std::fs::File;
use std::io::{Read, Seek, SeekFrom};
use std::ops::Range;
use std::path::Path;
use std::str::Utf8Error;

/// Reads a whole file.
///
/// # Errors
/// When it cannot be read.
pub fn read_bytes(path: impl AsRef<Path>) -> Result<Vec<u8>> {
    let path = path.as_ref();
    std::fs::read(path).map_err(Error::io(path))
}

/// Reads bytes of a file from one on up to another.
///
/// # Errors
/// When it cannot be read, or ends before.
pub fn read_part(path: impl AsRef<Path>, part: Range<u64>) -> Result<Vec<u8>> {
    let path = path.as_ref();
    let read = || {
        let mut file = File::open(path)?;
        file.seek(SeekFrom::Start(part.start))?;
        let mut bytes = Vec::new();
        file.take(part.end.saturating_sub(part.start)).read_to_end(&mut bytes)?;
        match bytes.len() as u64 == part.end.saturating_sub(part.start) {
            true => Ok(bytes),
            false => Err(std::io::ErrorKind::UnexpectedEof.into()),
        }
    };
    read().map_err(Error::io(path))
}

/// Length of a file, bytes.
///
/// # Errors
/// When it is not there.
pub fn file_length(path: impl AsRef<Path>) -> Result<u64> {
    let path = path.as_ref();
    Ok(std::fs::metadata(path).map_err(Error::io(path))?.len())
}

/// Mark that some editors put before UTF-8 text. It is no part of the text.
const BYTE_ORDER_MARK: &[u8] = b"\xef\xbb\xbf";

/// Text as bytes, without a byte order mark.
pub(crate) fn without_mark(bytes: &[u8]) -> &[u8] {
    bytes.strip_prefix(BYTE_ORDER_MARK).unwrap_or(bytes)
}

/// Reads a text file, without the byte order mark that it may begin with.
///
/// # Errors
/// When it cannot be read or is not UTF-8.
pub fn read_text(path: impl AsRef<Path>) -> Result<String> {
    let path = path.as_ref();
    let bytes = read_bytes(path)?;
    let mut text = String::from_utf8(bytes).map_err(|e| not_utf8(path, e.as_bytes(), e.utf8_error()))?;
    text.drain(..text.len() - without_mark(text.as_bytes()).len());
    // Lines that end in a carriage return alone would be one line, and a comment at the start all of the file.
    Ok(if text.contains('\r') && !text.contains('\n') { text.replace('\r', "\n") } else { text })
}

/// The text of a file in memory, without a byte order mark.
pub(crate) fn utf8<'a>(path: &Path, bytes: &'a [u8]) -> Result<&'a str> {
    str::from_utf8(without_mark(bytes)).map_err(|e| not_utf8(path, bytes, e))
}

/// The error of text in another encoding. PowerShell's `>` writes UTF-16.
fn not_utf8(path: &Path, bytes: &[u8], error: Utf8Error) -> Error {
    let found = match bytes {
        [0xff, 0xfe, ..] | [0xfe, 0xff, ..] => "UTF-16, which an editor can save as UTF-8",
        _ => "other bytes",
    };
    Error::invalid(path, format!("byte {}", error.valid_up_to()), "UTF-8 text", found)
}

/// Writes a text file atomically.
///
/// # Errors
/// When it cannot be written; an existing file is then left unchanged.
pub fn write_text(path: impl AsRef<Path>, text: &str) -> Result<()> {
    atomic_write(path, |w| w.write_all(text.as_bytes()))
}
