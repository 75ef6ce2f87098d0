//! Rotations in three or four bytes.

use std::f32::consts::{FRAC_1_SQRT_2, SQRT_2};

/// The inverse of [`smallest_three`], for a unit quaternion.
pub(super) fn pack_smallest_three(q: [f32; 4]) -> u32 {
    let largest = (1..4).fold(0, |at, i| if q[i].abs() > q[at].abs() { i } else { at });
    (0..4).filter(|&i| i != largest).fold(largest as u32, |bits, i| {
        let magnitude = (511.0 * SQRT_2 * q[i].abs()).round().min(511.0) as u32;
        // q and -q are the same rotation; the component left out counts as positive.
        let negative = (q[i] < 0.0) != (q[largest] < 0.0);
        bits << 10 | u32::from(negative) << 9 | magnitude
    })
}

/// A unit quaternion xyzw with w not negative from its first three components.
pub(super) fn first_three(packed: [u8; 3]) -> [f32; 4] {
    let [x, y, z] = packed.map(|b| f32::from(b) / 127.5 - 1.0);
    [x, y, z, (1.0 - x * x - y * y - z * z).max(0.0).sqrt()]
}

/// A unit quaternion xyzw from all but its largest component: two bits say which one is left out, then come ten
/// bits, sign and magnitude, for each of the others, the first in the highest bits.
pub(super) fn smallest_three(packed: u32) -> [f32; 4] {
    let largest = (packed >> 30) as usize;
    let mut quaternion = [0.0; 4];
    let mut squares = 0.0;
    let mut bits = packed;
    for i in (0..4).rev().filter(|&i| i != largest) {
        let magnitude = (bits & 511) as f32 / 511.0 * FRAC_1_SQRT_2;
        quaternion[i] = if bits & 512 == 0 { magnitude } else { -magnitude };
        squares += magnitude * magnitude;
        bits >>= 10;
    }
    quaternion[largest] = (1.0 - squares).max(0.0).sqrt();
    quaternion
}
