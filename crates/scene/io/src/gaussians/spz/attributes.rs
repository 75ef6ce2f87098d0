//! Gaussians as arrays of bytes, and back.

use super::Streams;
use super::header::Header;
use super::rotation::{first_three, pack_smallest_three, smallest_three};
use crate::gaussians::fields::{byte, unit};
use half::f16;
use weaver_geometry::sh;
use weaver_scene::{Gaussians, forms};

/// Colors are stored as `0.15 x + 0.5`.
const COLOR_SCALE: f32 = 0.15;

/// The Gaussians of parts of the arrays, with as many of each as the header demands for them.
pub(super) fn unpack(
    header: &Header,
    [positions, opacities, colors, scales, rotations, rest]: [&[u8]; 6],
) -> Gaussians {
    let mut gaussians = Gaussians { degree: usize::from(header.degree), ..Gaussians::default() };
    let sign = if header.turned { -1.0 } else { 1.0 };
    let turned = |[x, y, z]: [f32; 3]| [x, sign * y, sign * z];
    if header.version == 1 {
        let half = |p: &[u8; 6], i: usize| f16::from_le_bytes([p[2 * i], p[2 * i + 1]]).to_f32();
        gaussians.means = positions.as_chunks().0.iter().map(|p| turned([0, 1, 2].map(|i| half(p, i)))).collect();
    } else {
        let unit = f64::from(1u32 << header.fraction).recip();
        // Into the upper three bytes, so that the sign bit is in its place.
        let fixed = |p: &[u8; 9], i: usize| i32::from_le_bytes([0, p[3 * i], p[3 * i + 1], p[3 * i + 2]]) >> 8;
        let position = |p: &[u8; 9]| turned([0, 1, 2].map(|i| (f64::from(fixed(p, i)) * unit) as f32));
        gaussians.means = positions.as_chunks().0.iter().map(position).collect();
    }
    gaussians.opacity_logits = opacities.iter().map(|&o| forms::opacity_logit(f32::from(o) / 255.0)).collect();
    let scale = |s: &[u8; 3]| s.map(|s| f32::from(s) / 16.0 - 10.0);
    gaussians.log_scales = scales.as_chunks().0.iter().map(scale).collect();
    let quat = |[x, y, z, w]: [f32; 4]| [w, x, sign * y, sign * z];
    gaussians.quats = if header.version < 3 {
        rotations.as_chunks().0.iter().map(|&r| quat(first_three(r))).collect()
    } else {
        rotations.as_chunks().0.iter().map(|&r| quat(smallest_three(u32::from_le_bytes(r)))).collect()
    };
    let signs = signs(header);
    let rest = rest.as_chunks::<3>().0;
    for (i, color) in colors.as_chunks::<3>().0.iter().enumerate() {
        gaussians.sh.extend(color.map(|c| (f32::from(c) / 255.0 - 0.5) / COLOR_SCALE));
        for (sign, rgb) in signs[1..].iter().zip(&rest[i * header.rest()..][..header.rest()]) {
            gaussians.sh.extend(rgb.map(|b| sign * (f32::from(b) - 128.0) / 128.0));
        }
    }
    gaussians
}

/// Appends Gaussians to the arrays of version 3 or 4.
pub(super) fn pack(header: &Header, gaussians: &Gaussians, to: &mut Streams) {
    let sign = if header.turned { -1.0 } else { 1.0 };
    let steps = f64::from(1u32 << header.fraction);
    let fixed = |x: f32| (f64::from(x) * steps).round() as i32;
    let position = |[x, y, z]: &[f32; 3]| {
        let [x, y, z] = [*x, sign * y, sign * z].map(|x| fixed(x).to_le_bytes());
        [x[0], x[1], x[2], y[0], y[1], y[2], z[0], z[1], z[2]]
    };
    let color = |row: &[f32]| [0, 1, 2].map(|c| byte(255.0 * (COLOR_SCALE * row[c] + 0.5)));
    let rotation = |q: &[f32; 4]| {
        let [real, x, y, z] = unit(*q);
        pack_smallest_three([x, sign * y, sign * z, real]).to_le_bytes()
    };
    let rows = || gaussians.sh.chunks_exact(3 * gaussians.coefficients());
    let signs = signs(header);
    let harmonics = |row: &[f32], rest: &mut Vec<u8>| {
        let each = signs.iter().zip(row.as_chunks::<3>().0).skip(1);
        rest.extend(each.flat_map(|(sign, rgb)| rgb.map(|x| byte(128.0 * sign * x + 128.0))));
    };
    let [positions, opacities, colors, scales, rotations, rest] = to;
    positions.extend(gaussians.means.iter().flat_map(position));
    opacities.extend(gaussians.opacity_logits.iter().map(|logit| byte(255.0 * forms::opacity(*logit))));
    colors.extend(rows().flat_map(color));
    scales.extend(gaussians.log_scales.iter().flat_map(|scale| scale.map(|s| byte(16.0 * (s + 10.0)))));
    rotations.extend(gaussians.quats.iter().flat_map(rotation));
    rows().for_each(|row| harmonics(row, rest));
}

/// Sign of each spherical harmonic between the file's world and ours.
fn signs(header: &Header) -> [f32; sh::MAX_COEFFICIENTS] {
    if header.turned { sh::half_turn_signs(0) } else { [1.0; sh::MAX_COEFFICIENTS] }
}
