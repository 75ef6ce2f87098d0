//! The package around a text: a ZIP archive whose files are stored as they are and begin at multiples of 64 bytes.

use crate::files::bytes::Bytes;
use crate::files::content::Content;
use crate::{Error, Result};
use flate2::Crc;
use std::io::{self, Write};
use std::ops::Range;
use std::path::Path;

const LOCAL: &[u8; 4] = b"PK\x03\x04";
const CENTRAL: &[u8; 4] = b"PK\x01\x02";
const END: &[u8; 4] = b"PK\x05\x06";
/// Bytes of a file's header without its name.
const HEADER: usize = 30;
const ALIGNMENT: usize = 64;
/// The kind of extra field that pads headers in packages of OpenUSD.
const PADDING: u16 = 0x1986;
/// Version 1.0 of ZIP, which is enough for stored files.
const VERSION: u16 = 10;
/// The first of January 1980, the earliest day of ZIP: the same scene is the same file.
const DAY: u16 = 0x21;
const NAME: &[u8] = b"scene.usda";

/// The place of the package's first file, which is its root layer, and its checksum.
pub(super) fn first(path: &Path, content: &Content<'_>) -> Result<(Range<usize>, u32)> {
    let header = content.part(0..content.len().min(HEADER))?;
    let mut bytes = Bytes::new(path, &*header);
    let magic: [u8; 4] = bytes.take("a header")?;
    if magic != *LOCAL {
        return Err(Error::invalid(path, "content", "a USDZ package, which is a ZIP archive", format!("{magic:02x?}")));
    }
    bytes.skip(2, "a header")?;
    let [flags, method] = [bytes.take("a header")?, bytes.take("a header")?].map(u16::from_le_bytes);
    bytes.skip(4, "a header")?;
    let [checksum, packed, size] = [bytes.u32("a header")?, bytes.u32("a header")?, bytes.u32("a header")?];
    let [name, extra] = [bytes.take("a header")?, bytes.take("a header")?].map(u16::from_le_bytes);
    if method != 0 || packed != size || flags & 0b1001 != 0 {
        let found = format!("method {method}, flags {flags:#x}, {size} bytes in {packed}");
        return Err(Error::invalid(path, "first file", "one that is stored, with its length before it", found));
    }
    let start = HEADER + usize::from(name) + usize::from(extra);
    let end = start.checked_add(size as usize).filter(|end| *end <= content.len());
    let Some(end) = end else {
        let expected = format!("{size} bytes from {start}");
        return Err(Error::invalid(path, "first file", expected, format!("a package of {}", content.len())));
    };
    Ok((start..end, checksum))
}

/// Length and checksum of bytes that are written nowhere.
struct Measured(Crc, u64);

impl Write for Measured {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.0.update(bytes);
        self.1 += bytes.len() as u64;
        Ok(bytes.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

/// Writes a package of one text, which `text` writes the same each time.
pub(super) fn write(path: &Path, text: &dyn Fn(&mut dyn Write) -> Result<()>, w: &mut dyn Write) -> Result<()> {
    let mut measured = Measured(Crc::new(), 0);
    text(&mut measured)?;
    let Measured(crc, length) = measured;
    // Offsets beyond the text have to fit as well.
    let Some(size) = u32::try_from(length).ok().filter(|size| *size < u32::MAX - 1024) else {
        return Err(Error::invalid(path, "Gaussians to write", "less than 4 GB of text", format!("{length} bytes")));
    };
    // Four bytes of an extra field are its own header.
    let padding = ALIGNMENT - (HEADER + NAME.len() + 4) % ALIGNMENT;
    let about = |extra: usize| {
        let mut about = Vec::new();
        [VERSION, 0, 0, 0, DAY].iter().for_each(|word| about.extend(word.to_le_bytes()));
        [crc.sum(), size, size].iter().for_each(|word| about.extend(word.to_le_bytes()));
        [NAME.len() as u16, extra as u16].iter().for_each(|word| about.extend(word.to_le_bytes()));
        about
    };
    let mut head = [LOCAL.as_slice(), &about(4 + padding), NAME].concat();
    [PADDING, padding as u16].iter().for_each(|word| head.extend(word.to_le_bytes()));
    head.resize(head.len() + padding, 0);
    w.write_all(&head).map_err(Error::io(path))?;
    text(w)?;
    // No comment, first disk, no attributes, and the header at 0.
    let central = [CENTRAL.as_slice(), &VERSION.to_le_bytes(), &about(0), &[0; 14], NAME].concat();
    let mut end = [central.as_slice(), END, &[0; 4], &1_u16.to_le_bytes(), &1_u16.to_le_bytes()].concat();
    end.extend((central.len() as u32).to_le_bytes());
    end.extend((head.len() as u32 + size).to_le_bytes());
    end.extend([0; 2]);
    w.write_all(&end).map_err(Error::io(path))
}
