//! The compressed `.spz` format of Niantic: versions 2 and 3, which are gzip.
//!
//! A header of 16 bytes, then one array after the other: positions, opacities, colors, scales, rotations,
//! spherical harmonics. Its axes are those of OpenGL (x right, y up, z back), against x right, y down, z forward
//! in PLY files and here, so reading and writing turn everything by half a turn about x.

use crate::files::bytes::Bytes;
use crate::gaussians::fields::{byte, check_values, unit};
use crate::{Error, Result};
use flate2::Compression;
use flate2::read::GzDecoder;
use flate2::write::GzEncoder;
use std::io::{self, Read, Write};
use std::path::Path;
use weaver_geometry::sh;
use weaver_scene::{Gaussians, forms};

const MAGIC: u32 = u32::from_le_bytes(*b"NGSP");

/// Deflate makes no file more than about 1032 times smaller.
const LARGEST_RATIO: u64 = 1040;

/// Colors are stored as `0.15 x + 0.5`.
const COLOR_SCALE: f32 = 0.15;

/// Reads a `.spz` file of version 2 or 3, which has 24 bits per coordinate of positions and 8 for most other numbers.
///
/// # Errors
/// When the file is of another version or is malformed.
pub(crate) fn decode(path: &Path, packed: &[u8]) -> Result<Gaussians> {
    // Version 4 is not compressed as a whole: its header comes first.
    if packed.starts_with(&MAGIC.to_le_bytes()) {
        return Err(Error::invalid(path, "byte 0", "gzip (version 2 or 3)", "a later version of SPZ"));
    }
    let limit = packed.len() as u64 * LARGEST_RATIO;
    let invalid = |e| Error::invalid(path, "compressed data", "gzip", e);
    let mut data = Vec::new();
    let mut unpacked = GzDecoder::new(packed).take(HEADER);
    unpacked.read_to_end(&mut data).map_err(invalid)?;
    let header = Header::read(&mut Bytes::new(path, data.clone()))?;
    // What a file unpacks to is up to the file: no more is unpacked than its header speaks of, and a byte to see that there is more.
    unpacked.set_limit(limit.min(header.bytes().saturating_add(1)));
    unpacked.read_to_end(&mut data).map_err(invalid)?;
    let mut bytes = Bytes::new(path, data);
    bytes.take::<{ HEADER as usize }>("a header")?;
    unpack(path, &header, bytes)
}

/// Bytes of a header.
const HEADER: u64 = 16;

struct Header {
    version: u32,
    gaussians: u32,
    degree: u8,
    /// Bits after the point of positions.
    fraction: u8,
}

impl Header {
    fn read(bytes: &mut Bytes) -> Result<Self> {
        let magic = bytes.u32("a header")?;
        if magic != MAGIC {
            return Err(bytes.invalid("NGSP at the start of the unpacked data", format!("{magic:#010x}")));
        }
        let version = bytes.u32("a version")?;
        if !(2..=3).contains(&version) {
            return Err(bytes.invalid("version 2 or 3", version));
        }
        let gaussians = bytes.u32("a number of Gaussians")?;
        let [degree, fraction, _flags, _reserved] = bytes.take("a header")?;
        if degree > 4 || fraction > 24 {
            let found = format!("{degree} and {fraction}");
            return Err(bytes.invalid("an SH degree up to 4 and up to 24 fractional bits", found));
        }
        Ok(Self { version, gaussians, degree, fraction })
    }

    /// Coefficients of each color beyond the first.
    fn rest(&self) -> usize {
        sh::coefficients(usize::from(self.degree)) - 1
    }

    /// Bytes of the Gaussians.
    fn bytes(&self) -> u64 {
        let rotation = if self.version == 2 { 3 } else { 4 };
        u64::from(self.gaussians) * (9 + 1 + 3 + 3 + rotation + 3 * self.rest() as u64)
    }
}

fn unpack(path: &Path, header: &Header, mut bytes: Bytes) -> Result<Gaussians> {
    let (n, rest, expected) = (header.gaussians as usize, header.rest(), header.bytes());
    let found = bytes.rest().len() as u64;
    if found != expected {
        let found = if found > expected { "more".to_string() } else { found.to_string() };
        return Err(bytes.invalid(format!("{expected} bytes for {n} Gaussians"), found));
    }
    let Header { version, degree, fraction, .. } = *header;
    let mut gaussians = Gaussians { degree: usize::from(degree), ..Gaussians::default() };
    let unit = f64::from(1u32 << fraction).recip();
    for _ in 0..n {
        let p: [u8; 9] = bytes.take("a position")?;
        // Into the upper three bytes, so that the sign lands where it belongs.
        let coordinate = |i: usize| i32::from_le_bytes([0, p[3 * i], p[3 * i + 1], p[3 * i + 2]]) >> 8;
        let [x, y, z] = [0, 1, 2].map(|i| (f64::from(coordinate(i)) * unit) as f32);
        gaussians.means.push([x, -y, -z]);
    }
    for _ in 0..n {
        let opacity = f32::from(bytes.take::<1>("an opacity")?[0]) / 255.0;
        gaussians.opacity_logits.push(forms::opacity_logit(opacity));
    }
    let color = |c: u8| (f32::from(c) / 255.0 - 0.5) / COLOR_SCALE;
    let colors: Vec<[f32; 3]> = (0..n).map(|_| Ok(bytes.take("a color")?.map(color))).collect::<Result<_>>()?;
    for _ in 0..n {
        gaussians.log_scales.push(bytes.take("a scale")?.map(|s: u8| f32::from(s) / 16.0 - 10.0));
    }
    for _ in 0..n {
        let [x, y, z, w] = match version {
            2 => first_three(bytes.take("a rotation")?),
            _ => smallest_three(bytes.u32("a rotation")?),
        };
        gaussians.quats.push([w, x, -y, -z]);
    }
    let signs = half_turn_signs();
    for color in colors {
        gaussians.sh.extend(color);
        for sign in &signs[1..=rest] {
            let rgb: [u8; 3] = bytes.take("spherical harmonics")?;
            gaussians.sh.extend(rgb.map(|b| sign * (f32::from(b) - 128.0) / 128.0));
        }
    }
    check_values(path, &gaussians)?;
    Ok(gaussians)
}

/// Bits after the point of positions, where they are small enough: steps of a quarter millimeter if the unit is a meter.
const FRACTION: u8 = 12;

/// Writes a `.spz` file of version 3.
///
/// Positions are rounded to 24 bits per coordinate, rotations to 10 bits per component, all other numbers to 8 bits.
///
/// # Errors
/// When a value is not finite or a position is beyond 2^23.
pub(crate) fn encode(path: &Path, gaussians: &Gaussians, w: &mut dyn Write) -> Result<()> {
    check_values(path, gaussians)?;
    let largest = gaussians.means.as_flattened().iter().fold(0.0, |m: f32, x| m.max(x.abs()));
    let fits = |fraction: &u8| f64::from(largest) * f64::from(1u32 << fraction) < f64::from(1 << 23) - 1.0;
    let Some(fraction) = (0..=FRACTION).rev().find(fits) else {
        return Err(Error::invalid(path, "positions to write", "coordinates below 2^23", largest));
    };
    let mut packed = GzEncoder::new(w, Compression::default());
    pack(&mut packed, gaussians, fraction).and_then(|()| packed.finish()).map_err(Error::io(path))?;
    Ok(())
}

fn pack(w: &mut impl Write, gaussians: &Gaussians, fraction: u8) -> io::Result<()> {
    for word in [MAGIC, 3, gaussians.len() as u32] {
        w.write_all(&word.to_le_bytes())?;
    }
    w.write_all(&[gaussians.degree as u8, fraction, 0, 0])?;
    let steps = f64::from(1u32 << fraction);
    for [x, y, z] in &gaussians.means {
        for coordinate in [*x, -y, -z] {
            let fixed = (f64::from(coordinate) * steps).round() as i32;
            w.write_all(&fixed.to_le_bytes()[..3])?;
        }
    }
    for logit in &gaussians.opacity_logits {
        w.write_all(&[byte(255.0 * forms::opacity(*logit))])?;
    }
    let rows = || gaussians.sh.chunks_exact(3 * gaussians.coefficients());
    for row in rows() {
        w.write_all(&[0, 1, 2].map(|c| byte(255.0 * (COLOR_SCALE * row[c] + 0.5))))?;
    }
    for scale in &gaussians.log_scales {
        w.write_all(&scale.map(|s| byte(16.0 * (s + 10.0))))?;
    }
    for q in &gaussians.quats {
        let [real, x, y, z] = unit(*q);
        w.write_all(&pack_smallest_three([x, -y, -z, real]).to_le_bytes())?;
    }
    let signs = half_turn_signs();
    for row in rows() {
        for (sign, rgb) in signs.iter().zip(row.as_chunks::<3>().0).skip(1) {
            w.write_all(&rgb.map(|x| byte(128.0 * sign * x + 128.0)))?;
        }
    }
    Ok(())
}

/// The inverse of [`smallest_three`], for a unit quaternion.
fn pack_smallest_three(q: [f32; 4]) -> u32 {
    let largest = (1..4).fold(0, |at, i| if q[i].abs() > q[at].abs() { i } else { at });
    (0..4).filter(|&i| i != largest).fold(largest as u32, |bits, i| {
        let magnitude = (511.0 * std::f32::consts::SQRT_2 * q[i].abs()).round().min(511.0) as u32;
        // q and -q are the same rotation; the component left out counts as positive.
        let negative = (q[i] < 0.0) != (q[largest] < 0.0);
        bits << 10 | u32::from(negative) << 9 | magnitude
    })
}

/// A unit quaternion xyzw with w not negative from its first three components.
fn first_three(packed: [u8; 3]) -> [f32; 4] {
    let [x, y, z] = packed.map(|b| f32::from(b) / 127.5 - 1.0);
    [x, y, z, (1.0 - x * x - y * y - z * z).max(0.0).sqrt()]
}

/// A unit quaternion xyzw from all but its largest component: two bits say which one is left out, then come ten
/// bits, sign and magnitude, for each of the others, the first in the highest bits.
fn smallest_three(packed: u32) -> [f32; 4] {
    let largest = (packed >> 30) as usize;
    let mut quaternion = [0.0; 4];
    let mut squares = 0.0;
    let mut bits = packed;
    for i in (0..4).rev().filter(|&i| i != largest) {
        let magnitude = (bits & 511) as f32 / 511.0 * std::f32::consts::FRAC_1_SQRT_2;
        quaternion[i] = if bits & 512 == 0 { magnitude } else { -magnitude };
        squares += magnitude * magnitude;
        bits >>= 10;
    }
    quaternion[largest] = (1.0 - squares).max(0.0).sqrt();
    quaternion
}

/// How each spherical harmonic changes its sign when the world turns half about x.
fn half_turn_signs() -> [f32; sh::MAX_COEFFICIENTS] {
    // A direction at which none of them vanishes.
    let [x, y, z] = [0.675, 0.337, 0.656];
    let basis = |direction: [f32; 3]| sh::basis(sh::MAX_DEGREE, direction, |x| x as f32);
    let (before, after) = (basis([x, y, z]), basis([x, -y, -z]));
    std::array::from_fn(|i| if before[i] * after[i] < 0.0 { -1.0 } else { 1.0 })
}
