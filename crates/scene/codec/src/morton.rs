//! Morton codes: the bits of coordinates interleaved, so that neighbors in order are near in space.

/// Spreads 32 bits to every second place.
fn spread2(x: u32) -> u64 {
    let x = u64::from(x);
    let x = (x | x << 16) & 0x0000_ffff_0000_ffff;
    let x = (x | x << 8) & 0x00ff_00ff_00ff_00ff;
    let x = (x | x << 4) & 0x0f0f_0f0f_0f0f_0f0f;
    let x = (x | x << 2) & 0x3333_3333_3333_3333;
    (x | x << 1) & 0x5555_5555_5555_5555
}

fn gather2(x: u64) -> u32 {
    let x = x & 0x5555_5555_5555_5555;
    let x = (x | x >> 1) & 0x3333_3333_3333_3333;
    let x = (x | x >> 2) & 0x0f0f_0f0f_0f0f_0f0f;
    let x = (x | x >> 4) & 0x00ff_00ff_00ff_00ff;
    let x = (x | x >> 8) & 0x0000_ffff_0000_ffff;
    (x | x >> 16) as u32
}

/// Spreads 21 bits to every third place.
fn spread3(x: u32) -> u64 {
    let x = u64::from(x & 0x1f_ffff);
    let x = (x | x << 32) & 0x001f_0000_0000_ffff;
    let x = (x | x << 16) & 0x001f_0000_ff00_00ff;
    let x = (x | x << 8) & 0x100f_00f0_0f00_f00f;
    let x = (x | x << 4) & 0x10c3_0c30_c30c_30c3;
    (x | x << 2) & 0x1249_2492_4924_9249
}

fn gather3(x: u64) -> u32 {
    let x = x & 0x1249_2492_4924_9249;
    let x = (x | x >> 2) & 0x10c3_0c30_c30c_30c3;
    let x = (x | x >> 4) & 0x100f_00f0_0f00_f00f;
    let x = (x | x >> 8) & 0x001f_0000_ff00_00ff;
    let x = (x | x >> 16) & 0x001f_0000_0000_ffff;
    ((x | x >> 32) & 0x1f_ffff) as u32
}

/// The Morton code of a pixel; the first coordinate has the lowest bit.
pub fn morton2([x, y]: [u32; 2]) -> u64 {
    spread2(x) | spread2(y) << 1
}

/// The pixel of a Morton code.
pub fn from_morton2(code: u64) -> [u32; 2] {
    [gather2(code), gather2(code >> 1)]
}

/// The Morton code of a voxel, of the lowest 21 bits of each coordinate; the first coordinate has the lowest bit.
///
/// ```
/// use weaver_codec::{from_morton3, morton3};
///
/// assert_eq!(morton3([0b11, 0b01, 0b10]), 0b101_011);
/// assert_eq!(from_morton3(0b101_011), [0b11, 0b01, 0b10]);
/// ```
pub fn morton3([x, y, z]: [u32; 3]) -> u64 {
    spread3(x) | spread3(y) << 1 | spread3(z) << 2
}

/// The voxel of a Morton code.
pub fn from_morton3(code: u64) -> [u32; 3] {
    [gather3(code), gather3(code >> 1), gather3(code >> 2)]
}
