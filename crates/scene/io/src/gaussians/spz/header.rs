//! The common beginning of every version.

use crate::Result;
use crate::files::bytes::Bytes;
use std::io::{self, Write};
use weaver_geometry::sh;

/// The first four bytes.
pub(super) const MAGIC: u32 = u32::from_le_bytes(*b"NGSP");

/// Bytes of a header; version 4 has more.
pub(super) const BYTES: usize = 16;

/// The bit of `flags` that says how Gaussians were trained.
const ANTIALIASED: u8 = 1;

/// Header of the arrays.
pub(super) struct Header {
    pub version: u32,
    pub gaussians: u32,
    pub degree: u8,
    /// Bits after the point of positions.
    pub fraction: u8,
    pub antialiased: bool,
    /// The file's axes follow OpenGL, not PLY files.
    pub turned: bool,
}

impl Header {
    /// Reads the first 16 bytes, which are of one of these versions; the last byte, whose meaning differs, comes along.
    pub(super) fn read(bytes: &mut Bytes, versions: std::ops::RangeInclusive<u32>) -> Result<(Self, u8)> {
        let magic = bytes.u32("a header")?;
        if magic != MAGIC {
            return Err(bytes.invalid("NGSP at the start of the unpacked data", format!("{magic:#010x}")));
        }
        let version = bytes.u32("a version")?;
        if !versions.contains(&version) {
            let (first, last) = versions.into_inner();
            let expected =
                if first == last { format!("version {first}") } else { format!("version {first} to {last}") };
            return Err(bytes.invalid(expected, version));
        }
        let gaussians = bytes.u32("a number of Gaussians")?;
        let [degree, fraction, flags, last] = bytes.take("a header")?;
        if degree > 4 || fraction > 24 {
            let found = format!("{degree} and {fraction}");
            return Err(bytes.invalid("an SH degree up to 4 and up to 24 fractional bits", found));
        }
        let antialiased = flags & ANTIALIASED != 0;
        Ok((Self { version, gaussians, degree, fraction, antialiased, turned: true }, last))
    }

    /// Writes the first 16 bytes.
    pub(super) fn write(&self, last: u8, w: &mut dyn Write) -> io::Result<()> {
        for word in [MAGIC, self.version, self.gaussians] {
            w.write_all(&word.to_le_bytes())?;
        }
        w.write_all(&[self.degree, self.fraction, if self.antialiased { ANTIALIASED } else { 0 }, last])
    }

    /// Coefficients of each color beyond the first.
    pub(super) fn rest(&self) -> usize {
        sh::coefficients(usize::from(self.degree)) - 1
    }

    /// Bytes of a Gaussian in each array.
    pub(super) fn sizes(&self) -> [usize; 6] {
        let position = if self.version == 1 { 6 } else { 9 };
        let rotation = if self.version < 3 { 3 } else { 4 };
        [position, 1, 3, 3, rotation, 3 * self.rest()]
    }

    /// Bytes of each array.
    pub(super) fn lengths(&self) -> [u64; 6] {
        self.sizes().map(|size| size as u64 * u64::from(self.gaussians))
    }
}
