//! The size that a TIFF announces before its pixels.

use std::io::{Read, Seek, SeekFrom};

/// The first value of a TIFF's first directory that is longer than the file, in words; `None` if there is none, or the
/// file is of another kind. A decoder takes memory for it before it reads.
pub(super) fn too_long(file: &mut (impl Read + Seek)) -> Option<String> {
    let length = file.seek(SeekFrom::End(0)).ok()?;
    file.rewind().ok()?;
    let mut start = [0; 4];
    file.read_exact(&mut start).ok()?;
    let (big_endian, big) = match &start {
        b"II*\0" => (false, false),
        b"MM\0*" => (true, false),
        b"II+\0" => (false, true),
        b"MM\0+" => (true, true),
        _ => return None,
    };
    let number = |file: &mut dyn Read, bytes: usize| -> Option<u64> {
        let mut read = [0; 8];
        file.read_exact(&mut read[..bytes]).ok()?;
        if big_endian {
            read[..bytes].reverse();
        }
        Some(u64::from_le_bytes(read))
    };
    // An offset has 4 or 8 bytes; the latter come after the size of an offset and zeros.
    let size = if big { 8 } else { 4 };
    if big {
        number(file, 4)?;
    }
    let directory = number(file, size)?;
    file.seek(SeekFrom::Start(directory)).ok()?;
    for _ in 0..number(file, if big { 8 } else { 2 })? {
        let (tag, kind, count) = (number(file, 2)?, number(file, 2)?, number(file, size)?);
        number(file, size)?;
        let each = match kind {
            3 | 8 => 2,
            4 | 9 | 11 | 13 => 4,
            5 | 10 | 12 | 16..=18 => 8,
            _ => 1,
        };
        if count.saturating_mul(each) > length {
            return Some(format!("{count} values under tag {tag}"));
        }
    }
    None
}
