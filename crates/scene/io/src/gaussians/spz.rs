//! The compressed `.spz` format of Niantic: versions 1 to 3, which are gzip, and 4, whose arrays are zstd streams.
//!
//! A header, then positions, opacities, colors, scales, rotations and spherical harmonics, each an array of all Gaussians. Its axes
//! are those of OpenGL (x right, y up, z back), against x right, y down, z forward in PLY files and here, so reading and writing turn
//! everything by half a turn about x, unless a file of version 4 names the axes of PLY files.
//!
//! Source: the README of github.com/nianticlabs/spz and of its extensions.

mod attributes;
mod gzip;
mod header;
mod rotation;
mod zstd;

use crate::gaussians::fields::check_values;
use crate::gaussians::scene_file::{Drawing, SceneFile};
use crate::{Error, Result};
use attributes::{pack, unpack};
use header::{Header, MAGIC};
use std::io::Write;
use std::path::Path;
use weaver_scene::Gaussians;

/// The arrays: positions, opacities, colors, scales, rotations, harmonics.
type Streams = [Vec<u8>; 6];

/// Reads a `.spz` file of any version, which has 24 bits per coordinate of positions (the first version 16-bit floats) and 8 for most
/// other numbers.
///
/// # Errors
/// When the file is of another version or is malformed.
pub(crate) fn decode(path: &Path, data: &[u8]) -> Result<SceneFile> {
    // Version 4 is not compressed as a whole: its header comes first.
    let plain = data.starts_with(&MAGIC.to_le_bytes());
    let (header, streams) = if plain { zstd::read(path, data)? } else { gzip::read(path, data)? };
    let gaussians = unpack(&header, &streams);
    check_values(path, &gaussians)?;
    Ok(SceneFile { gaussians, drawing: Drawing::antialiased(header.antialiased) })
}

/// Writes a `.spz` file of version 3, which more programs read.
///
/// Positions are rounded to 24 bits per coordinate, rotations to 10 bits per component, all other numbers to 8 bits.
///
/// # Errors
/// When a value is not finite or a position is beyond 2^23.
pub(crate) fn encode(path: &Path, gaussians: &Gaussians, drawing: Drawing, w: &mut dyn Write) -> Result<()> {
    let header = header(path, gaussians, drawing, 3)?;
    gzip::write(&header, &pack(&header, gaussians), w).map_err(Error::io(path))
}

/// Writes a `.spz` file of version 4.
///
/// # Errors
/// As [`encode`].
pub(crate) fn encode_zstd(path: &Path, gaussians: &Gaussians, drawing: Drawing, w: &mut dyn Write) -> Result<()> {
    let header = header(path, gaussians, drawing, 4)?;
    zstd::write(&header, &pack(&header, gaussians), w).map_err(Error::io(path))
}

/// Bits after the point of positions, where they are small enough: steps of a quarter millimeter if the unit is a meter.
const FRACTION: u8 = 12;

fn header(path: &Path, gaussians: &Gaussians, drawing: Drawing, version: u32) -> Result<Header> {
    check_values(path, gaussians)?;
    let largest = gaussians.means.as_flattened().iter().fold(0.0, |m: f32, x| m.max(x.abs()));
    let fits = |fraction: &u8| f64::from(largest) * f64::from(1u32 << fraction) < f64::from(1 << 23) - 1.0;
    let Some(fraction) = (0..=FRACTION).rev().find(fits) else {
        return Err(Error::invalid(path, "positions to write", "coordinates below 2^23", largest));
    };
    let Ok(count) = u32::try_from(gaussians.len()) else {
        return Err(Error::invalid(path, "Gaussians to write", "fewer than 2^32", gaussians.len()));
    };
    let degree = gaussians.degree as u8;
    Ok(Header { version, gaussians: count, degree, fraction, antialiased: drawing.antialiased, turned: true })
}
