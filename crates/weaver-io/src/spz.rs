//! The compressed `.spz` form of Niantic, versions 2 and 3 (gzip).
//!
//! A header of 16 bytes, then one array after the other: positions, opacities, colors, scales, rotations,
//! spherical harmonics. Its axes are those of OpenGL (x right, y up, z back), against x right, y down, z forward
//! in PLY files and here, so everything is turned half about x on reading.

use crate::bytes::Bytes;
use crate::file::read_bytes;
use crate::ply::check;
use crate::{Error, Result};
use flate2::read::GzDecoder;
use std::io::Read;
use std::path::Path;
use weaver_geometry::sh;
use weaver_scene::Gaussians;

const MAGIC: u32 = u32::from_le_bytes(*b"NGSP");

/// Deflate makes no file more than about 1032 times smaller.
const LARGEST_RATIO: u64 = 1040;

/// Colors are stored as `0.15 x + 0.5`.
const COLOR_SCALE: f32 = 0.15;

/// Reads a `.spz` file of version 2 or 3. Values are as coarse as the format: 8 bits for most, 24 for positions.
pub fn read_spz(path: impl AsRef<Path>) -> Result<Gaussians> {
    let path = path.as_ref();
    let packed = read_bytes(path)?;
    // Version 4 is not compressed as a whole: its header comes first.
    if packed.starts_with(&MAGIC.to_le_bytes()) {
        return Err(Error::invalid(path, "byte 0", "gzip (version 2 or 3)", "a later version of SPZ"));
    }
    let mut data = Vec::new();
    let limit = packed.len() as u64 * LARGEST_RATIO;
    GzDecoder::new(packed.as_slice())
        .take(limit)
        .read_to_end(&mut data)
        .map_err(|e| Error::invalid(path, "compressed data", "gzip", e))?;
    unpack(path, Bytes::new(path, data))
}

fn unpack(path: &Path, mut bytes: Bytes) -> Result<Gaussians> {
    let magic = bytes.u32("a header")?;
    if magic != MAGIC {
        return Err(bytes.invalid("NGSP at the start of the unpacked data", format!("{magic:#010x}")));
    }
    let version = bytes.u32("a version")?;
    if !(2..=3).contains(&version) {
        return Err(bytes.invalid("version 2 or 3", version));
    }
    let n = bytes.u32("a number of Gaussians")? as usize;
    let [degree, fraction, _flags, _reserved] = bytes.take("a header")?;
    if degree > 4 || fraction > 24 {
        let found = format!("{degree} and {fraction}");
        return Err(bytes.invalid("an SH degree up to 4 and up to 24 fractional bits", found));
    }
    let degree = usize::from(degree);
    let rest = sh::coefficients(degree) - 1;
    let rotation = if version == 2 { 3 } else { 4 };
    let expected = n * (9 + 1 + 3 + 3 + rotation + 3 * rest);
    if bytes.rest().len() != expected {
        return Err(bytes.invalid(format!("{expected} bytes for {n} Gaussians"), bytes.rest().len()));
    }

    let mut splats = Gaussians { degree, ..Gaussians::default() };
    let unit = f64::from(1u32 << fraction).recip();
    for _ in 0..n {
        let p: [u8; 9] = bytes.take("a position")?;
        // Into the upper three bytes, so that the sign lands where it belongs.
        let coordinate = |i: usize| i32::from_le_bytes([0, p[3 * i], p[3 * i + 1], p[3 * i + 2]]) >> 8;
        let [x, y, z] = [0, 1, 2].map(|i| (f64::from(coordinate(i)) * unit) as f32);
        splats.means.push([x, -y, -z]);
    }
    for _ in 0..n {
        let opacity = f32::from(bytes.take::<1>("an opacity")?[0]) / 255.0;
        splats.opacity_logits.push((opacity / (1.0 - opacity)).ln());
    }
    let color = |c: u8| (f32::from(c) / 255.0 - 0.5) / COLOR_SCALE;
    let colors: Vec<[f32; 3]> = (0..n).map(|_| Ok(bytes.take("a color")?.map(color))).collect::<Result<_>>()?;
    for _ in 0..n {
        splats.log_scales.push(bytes.take("a scale")?.map(|s: u8| f32::from(s) / 16.0 - 10.0));
    }
    for _ in 0..n {
        let [x, y, z, w] = match version {
            2 => first_three(bytes.take("a rotation")?),
            _ => smallest_three(bytes.u32("a rotation")?),
        };
        splats.quats.push([w, x, -y, -z]);
    }
    let signs = half_turn_signs();
    for color in colors {
        splats.sh.extend(color);
        for sign in &signs[1..=rest] {
            let rgb: [u8; 3] = bytes.take("spherical harmonics")?;
            splats.sh.extend(rgb.map(|b| sign * (f32::from(b) - 128.0) / 128.0));
        }
    }
    check(path, &splats)?;
    Ok(splats)
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
