//! TensorBoard event files: length-prefixed, checksummed protocol-buffer records of scalars.

use std::path::Path;
use std::time::{SystemTime, UNIX_EPOCH};
use weaver_io::{Appender, Result};

/// An event file for TensorBoard, to which scalars are appended.
#[derive(Debug)]
pub struct TensorBoard {
    file: Appender,
}

impl TensorBoard {
    /// Starts a new event file in a folder, which is created if need be.
    ///
    /// # Errors
    /// When it cannot be created.
    pub fn create(folder: impl AsRef<Path>) -> Result<Self> {
        let folder = folder.as_ref();
        weaver_io::create_folder(folder)?;
        let name = format!("events.out.tfevents.{:.0}.splatweaver", now());
        let mut file = Appender::open(folder.join(name))?;
        // Event { wall_time, file_version }
        let mut event = wall_time();
        bytes(&mut event, 3, b"brain.Event:2");
        file.append(&record(&event))?;
        Ok(Self { file })
    }

    /// Appends the values of a step by their names; a slash in a name groups the charts.
    ///
    /// # Errors
    /// When the file cannot be written.
    pub fn scalars(&mut self, step: usize, values: &[(impl AsRef<str>, f32)]) -> Result<()> {
        let mut summary = Vec::new();
        for (tag, value) in values {
            // Summary.Value { tag, simple_value }
            let mut item = Vec::new();
            bytes(&mut item, 1, tag.as_ref().as_bytes());
            key(&mut item, 2, 5);
            item.extend(value.to_le_bytes());
            bytes(&mut summary, 1, &item);
        }
        // Event { wall_time, step, summary }
        let mut event = wall_time();
        key(&mut event, 2, 0);
        varint(&mut event, step as u64);
        bytes(&mut event, 5, &summary);
        self.file.append(&record(&event))
    }
}

fn now() -> f64 {
    SystemTime::now().duration_since(UNIX_EPOCH).map_or(0.0, |d| d.as_secs_f64())
}

fn wall_time() -> Vec<u8> {
    let mut event = Vec::new();
    key(&mut event, 1, 1);
    event.extend(now().to_le_bytes());
    event
}

fn varint(out: &mut Vec<u8>, mut value: u64) {
    while value >= 0x80 {
        out.push(value as u8 | 0x80);
        value >>= 7;
    }
    out.push(value as u8);
}

fn key(out: &mut Vec<u8>, field: u64, wire: u64) {
    varint(out, field << 3 | wire);
}

fn bytes(out: &mut Vec<u8>, field: u64, content: &[u8]) {
    key(out, field, 2);
    varint(out, content.len() as u64);
    out.extend(content);
}

/// Length, its masked checksum, the content, its masked checksum.
fn record(content: &[u8]) -> Vec<u8> {
    let masked = |data: &[u8]| crc32c::crc32c(data).rotate_right(15).wrapping_add(0xa282_ead8).to_le_bytes();
    let length = (content.len() as u64).to_le_bytes();
    [&length[..], &masked(&length), content, &masked(content)].concat()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn records_are_framed_and_checksummed() {
        let r = record(b"abc");
        assert_eq!((r.len(), &r[..8], &r[12..15]), (8 + 4 + 3 + 4, &3u64.to_le_bytes()[..], &b"abc"[..]));
        // The checksum of nine ASCII digits is the test vector of RFC 3720.
        assert_eq!(crc32c::crc32c(b"123456789"), 0xe306_9283);
    }

    #[test]
    fn varints_are_little_endian_groups_of_seven() {
        let mut out = Vec::new();
        varint(&mut out, 300);
        assert_eq!(out, [0xac, 0x02]);
    }
}
