//! Version 4: a header of 32 bytes, extensions, a table of sizes, and each array as a zstd stream of its own.

use super::Streams;
use super::header::{BYTES, Header};
use crate::files::bytes::Bytes;
use crate::{Error, Result};
use ruzstd::decoding::StreamingDecoder;
use ruzstd::encoding::{CompressionLevel, compress_to_vec};
use std::io::{self, Read, Write};
use std::path::Path;

const NAMES: [&str; 6] = ["positions", "opacities", "colors", "scales", "rotations", "harmonics"];

/// Bytes before the extensions.
const HEADER: usize = 32;
/// Bytes of a row of the table: the compressed and the original size.
const ROW: usize = 16;
/// The bit of `flags` for extensions.
const EXTENDED: u8 = 2;
/// The extension that names the axes, and its values for OpenGL's and for PLY files'.
const AXES: u32 = 0xadbe_0003;
const AXES_UNKNOWN: u32 = 0;
const AXES_OPENGL: u32 = 4;
const AXES_PLY: u32 = 6;
/// A window that every encoder may use for any data.
const WINDOW: u64 = 8 << 20;
/// A block of 128 KB takes at least four bytes.
const LARGEST_RATIO: u64 = 1 << 15;

pub(super) fn read(path: &Path, data: &[u8]) -> Result<(Header, Streams)> {
    let mut bytes = Bytes::new(path, data);
    let (mut header, count) = Header::read(&mut bytes, 4..=4)?;
    let table = bytes.u32("the place of the table")? as usize;
    let _reserved: [u8; HEADER - BYTES - 4] = bytes.take("a header")?;
    let streams = if header.degree == 0 { 5 } else { 6 };
    // Some encoders list the harmonics even where there are none.
    if usize::from(count) != streams && count != 6 {
        return Err(Error::invalid(path, "byte 15", format!("{streams} streams"), count));
    }
    let end = table.checked_add(ROW * usize::from(count)).filter(|end| table >= HEADER && *end <= data.len());
    let Some(mut at) = end else {
        let expected = format!("a place of the table from {HEADER} to {}", data.len());
        return Err(Error::invalid(path, "byte 16", expected, table));
    };
    if data[14] & EXTENDED != 0 {
        header.turned = turned(&mut Bytes::new(path, &data[HEADER..table]))?;
    }
    let mut rows = Bytes::new(path, &data[table..at]);
    let (mut found, lengths) = (Streams::default(), header.lengths());
    for i in 0..usize::from(count) {
        let (packed, length) = (rows.u64("a compressed size")?, rows.u64("a size")?);
        let (name, left) = (NAMES[i], (data.len() - at) as u64);
        let place = format!("byte {}", table + ROW * i);
        if packed > left {
            return Err(Error::invalid(path, place, format!("at most {left} bytes of {name}"), packed));
        }
        let limit = packed.saturating_mul(LARGEST_RATIO);
        if length != lengths[i] || length > limit {
            let expected = format!("{} bytes of {name} for {} Gaussians", lengths[i], header.gaussians);
            let unpacked = if length == lengths[i] { format!("{packed} compressed to") } else { length.to_string() };
            return Err(Error::invalid(path, place, expected, unpacked));
        }
        found[i] = decompressed(path, &data[at..][..packed as usize], length, (name, at))?;
        at += packed as usize;
    }
    if at != data.len() {
        let found = format!("{} more bytes", data.len() - at);
        return Err(Error::invalid(path, format!("byte {at}"), "the end of the file", found));
    }
    Ok((header, found))
}

/// True if the axes follow OpenGL, the default without an extension.
fn turned(records: &mut Bytes) -> Result<bool> {
    let mut turned = true;
    while !records.rest().is_empty() {
        let (kind, length) = (records.u32("an extension")?, records.u32("the length of an extension")?);
        if kind == AXES && length == 4 {
            turned = match records.u32("axes")? {
                AXES_UNKNOWN | AXES_OPENGL => true,
                AXES_PLY => false,
                other => return Err(records.invalid("axes right-up-back (4) or right-down-front (6)", other)),
            };
        } else {
            records.skip(length as usize, "an extension")?;
        }
    }
    Ok(turned)
}

/// Decompresses to `length` bytes, and no further.
fn decompressed(path: &Path, packed: &[u8], length: u64, (name, at): (&str, usize)) -> Result<Vec<u8>> {
    let invalid = |found: String| {
        let expected = format!("a zstd stream of {length} bytes of {name}");
        Error::invalid(path, format!("byte {at}"), expected, found)
    };
    let window = WINDOW.max(length.next_power_of_two());
    let decoder = StreamingDecoder::new_with_max_window_size(packed, window).map_err(|e| invalid(e.to_string()))?;
    let mut data = Vec::new();
    decoder.take(length + 1).read_to_end(&mut data).map_err(|e| invalid(e.to_string()))?;
    match data.len() as u64 {
        found if found == length => Ok(data),
        found if found > length => Err(invalid("more".into())),
        found => Err(invalid(format!("{found} bytes"))),
    }
}

pub(super) fn write(header: &Header, streams: &Streams, w: &mut dyn Write) -> io::Result<()> {
    let count = if header.degree == 0 { 5 } else { 6 };
    let packed = streams[..count].iter().map(|stream| compress_to_vec(&stream[..], CompressionLevel::Fastest));
    let packed: Vec<Vec<u8>> = packed.collect();
    header.write(count as u8, w)?;
    w.write_all(&(HEADER as u32).to_le_bytes())?;
    w.write_all(&[0; HEADER - BYTES - 4])?;
    for (packed, stream) in packed.iter().zip(streams) {
        w.write_all(&(packed.len() as u64).to_le_bytes())?;
        w.write_all(&(stream.len() as u64).to_le_bytes())?;
    }
    packed.iter().try_for_each(|packed| w.write_all(packed))
}
