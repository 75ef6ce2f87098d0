//! The compressed `.spz` format of Niantic: versions 1 to 3, which are gzip, and 4, whose arrays are zstd streams.
//!
//! A header, then positions, opacities, colors, scales, rotations and spherical harmonics, each an array of all
//! Gaussians. Its axes follow OpenGL (x right, y up, z back), against x right, y down, z forward in PLY files and here,
//! so reading and writing turn everything by half a turn about x, unless a file of version 4 names the axes of PLY
//! files.
//!
//! Source: the README of github.com/nianticlabs/spz and of its extensions.

mod attributes;
mod gzip;
mod header;
mod rotation;
mod zstd;

use crate::files::content::Content;
use crate::gaussians::blocks::Blocks;
use crate::gaussians::fields::check_rows;
use crate::gaussians::scene_file::{Drawing, OpenScene};
use crate::{Error, Result};
use attributes::{pack, unpack};
use header::{Header, MAGIC};
use std::borrow::Cow;
use std::io::Write;
use std::ops::Range;
use std::path::{Path, PathBuf};
use weaver_scene::Gaussians;

/// The arrays: positions, opacities, colors, scales, rotations, harmonics.
type Streams = [Vec<u8>; 6];

/// Opens a `.spz` file of any version, which has 24 bits per coordinate of positions (the first version 16-bit floats)
/// and 8 for most other numbers. Its arrays are held as the file has them, and unpacked on demand.
///
/// # Errors
/// When the file is of another version or is malformed.
pub(crate) fn open<'a>(path: &Path, content: Content<'a>) -> Result<OpenScene<'a>> {
    let data = content.all()?;
    // Version 4 is not compressed as a whole: its header comes first.
    let plain = data.starts_with(&MAGIC.to_le_bytes());
    let (header, streams) = if plain { zstd::read(path, &data)? } else { gzip::read(path, &data)? };
    let drawing = Drawing::antialiased(header.antialiased);
    Ok(OpenScene { gaussians: Box::new(Arrays { path: path.to_path_buf(), header, streams }), drawing })
}

/// The arrays that a file unpacks to.
struct Arrays {
    path: PathBuf,
    header: Header,
    streams: Streams,
}

impl Blocks for Arrays {
    fn len(&self) -> usize {
        self.header.gaussians as usize
    }

    fn degree(&self) -> usize {
        usize::from(self.header.degree)
    }

    fn block(&self, rows: Range<usize>) -> Result<Cow<'_, Gaussians>> {
        let sizes = self.header.sizes();
        let part = |i: usize| &self.streams[i][rows.start * sizes[i]..rows.end * sizes[i]];
        let gaussians = unpack(&self.header, std::array::from_fn(part));
        check_rows(&self.path, &gaussians, rows.start)?;
        Ok(Cow::Owned(gaussians))
    }
}

/// Writes a `.spz` file of version 3, which more programs read.
///
/// Positions are rounded to 24 bits per coordinate, rotations to 10 bits per component, all other numbers to 8 bits.
///
/// # Errors
/// When a value is not finite or a position is beyond 2^23.
pub(crate) fn encode(path: &Path, gaussians: &dyn Blocks, drawing: Drawing, w: &mut dyn Write) -> Result<()> {
    let header = header(path, gaussians, drawing, 3)?;
    gzip::write(&header, &packed(&header, gaussians)?, w).map_err(Error::io(path))
}

/// Writes a `.spz` file of version 4.
///
/// # Errors
/// As [`encode`].
pub(crate) fn encode_zstd(path: &Path, gaussians: &dyn Blocks, drawing: Drawing, w: &mut dyn Write) -> Result<()> {
    let header = header(path, gaussians, drawing, 4)?;
    zstd::write(&header, &packed(&header, gaussians)?, w).map_err(Error::io(path))
}

/// The arrays of all Gaussians, at most a quarter of the Gaussians' own size.
fn packed(header: &Header, gaussians: &dyn Blocks) -> Result<Streams> {
    let mut streams = header.lengths().map(|length| Vec::with_capacity(length as usize));
    for rows in gaussians.blocks() {
        pack(header, &*gaussians.block(rows)?, &mut streams);
    }
    Ok(streams)
}

/// Bits after the point of positions, where they are small enough: steps of a quarter millimeter if the unit is a
/// meter.
const FRACTION: u8 = 12;

/// Bits after the point of positions up to this largest coordinate; `None` where they have no place at all.
fn fraction(largest: f32) -> Option<u8> {
    let fits = |fraction: &u8| f64::from(largest) * f64::from(1u32 << fraction) < f64::from(1 << 23) - 1.0;
    (0..=FRACTION).rev().find(fits)
}

/// The step by which positions are rounded in `.spz`; `None` where they are beyond the range of the format.
pub fn spz_step(gaussians: &Gaussians) -> Option<f64> {
    let largest = gaussians.means.as_flattened().iter().fold(0.0_f32, |most, x| most.max(x.abs()));
    fraction(largest).map(|fraction| (-f64::from(fraction)).exp2())
}

fn header(path: &Path, gaussians: &dyn Blocks, drawing: Drawing, version: u32) -> Result<Header> {
    let mut largest = 0.0_f32;
    for rows in gaussians.blocks() {
        let block = gaussians.block(rows.clone())?;
        check_rows(path, &block, rows.start)?;
        largest = block.means.as_flattened().iter().fold(largest, |m, x| m.max(x.abs()));
    }
    let Some(fraction) = fraction(largest) else {
        return Err(Error::invalid(path, "positions to write", "coordinates below 2^23", largest));
    };
    let Ok(count) = u32::try_from(gaussians.len()) else {
        return Err(Error::invalid(path, "Gaussians to write", "fewer than 2^32", gaussians.len()));
    };
    let degree = gaussians.degree() as u8;
    Ok(Header { version, gaussians: count, degree, fraction, antialiased: drawing.antialiased, turned: true })
}
