//! Versions 1 to 3: a header of 16 bytes and one array after the other, compressed as a whole.

use super::Streams;
use super::header::{BYTES, Header};
use crate::files::bytes::Bytes;
use crate::{Error, Result};
use flate2::Compression;
use flate2::read::GzDecoder;
use flate2::write::GzEncoder;
use std::io::{self, Read, Write};
use std::path::Path;

/// Deflate makes no file more than about 1032 times smaller.
const LARGEST_RATIO: u64 = 1040;

pub(super) fn read(path: &Path, packed: &[u8]) -> Result<(Header, Streams)> {
    let limit = packed.len() as u64 * LARGEST_RATIO;
    let invalid = |e| Error::invalid(path, "compressed data", "gzip", e);
    let mut start = Vec::new();
    let mut unpacked = GzDecoder::new(packed).take(BYTES as u64);
    unpacked.read_to_end(&mut start).map_err(invalid)?;
    let (header, _) = Header::read(&mut Bytes::new(path, start), 1..=3)?;
    let (lengths, n) = (header.lengths(), header.gaussians);
    let expected: u64 = lengths.iter().sum();
    let wrong = |found: String| {
        Error::invalid(path, format!("byte {BYTES}"), format!("{expected} bytes for {n} Gaussians"), found)
    };
    if expected > limit {
        return Err(wrong(format!("at most {limit}")));
    }
    // The file decides its unpacked size: no more is unpacked than its header announces.
    let mut streams = Streams::default();
    let mut so_far = 0;
    for (stream, length) in streams.iter_mut().zip(lengths) {
        unpacked.set_limit(length);
        so_far += unpacked.read_to_end(stream).map_err(invalid)? as u64;
        if stream.len() as u64 != length {
            return Err(wrong(so_far.to_string()));
        }
    }
    unpacked.set_limit(1);
    if unpacked.read_to_end(&mut Vec::new()).map_err(invalid)? > 0 {
        return Err(wrong("more".into()));
    }
    Ok((header, streams))
}

pub(super) fn write(header: &Header, streams: &Streams, w: &mut dyn Write) -> io::Result<()> {
    let mut packed = GzEncoder::new(w, Compression::default());
    header.write(0, &mut packed)?;
    streams.iter().try_for_each(|stream| packed.write_all(stream))?;
    packed.finish().map(drop)
}
