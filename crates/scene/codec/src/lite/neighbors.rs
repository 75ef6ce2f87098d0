//! Neighbors that a decoder has decoded already.

use crate::morton::from_morton3;
use weaver_kernels::simd;

/// Gaussians before one in Morton order among which its neighbors are looked for.
const WINDOW: usize = 24;

/// Neighbors of a Gaussian at most.
pub(super) const NEIGHBORS: usize = 3;

/// Bits of a distance in which its place in the window is kept.
const LOW_BITS: u32 = 31;

/// The nearest of the Gaussians shortly before each one in Morton order, the nearest first; of the first Gaussians only
/// as many as are before.
///
/// Of equally near ones it is the first. Distances count by the upper 27 bits of the square in `f32`.
pub(super) fn neighbors(voxels: &[u64]) -> Vec<[u32; NEIGHBORS]> {
    let places: Vec<[f32; 3]> = voxels.iter().map(|&voxel| from_morton3(voxel).map(|x| x as f32)).collect();
    let [x, y, z] = [0, 1, 2].map(|axis| places.iter().map(|place| place[axis]).collect::<Vec<_>>());
    let mut near = vec![[0; NEIGHBORS]; voxels.len()];
    simd::dispatch(
        #[inline(always)]
        || {
            for (i, near) in near.iter_mut().enumerate().skip(1) {
                let first = i.saturating_sub(WINDOW);
                let mut keys = [u32::MAX; WINDOW];
                let before = x[first..i].iter().zip(&y[first..i]).zip(&z[first..i]);
                for ((key, lane), ((a, b), c)) in keys.iter_mut().zip(0..).zip(before) {
                    let (a, b, c) = (a - x[i], b - y[i], c - z[i]);
                    *key = (a * a + b * b + c * c).to_bits() & !LOW_BITS | lane;
                }
                for near in near.iter_mut().take(i) {
                    let least = keys.iter().fold(u32::MAX, |least, &key| least.min(key));
                    keys.iter_mut().for_each(|key| *key = if *key == least { u32::MAX } else { *key });
                    *near = first as u32 + (least & LOW_BITS);
                }
            }
        },
    );
    near
}

/// The neighbors of one Gaussian.
#[inline(always)]
pub(super) fn known(near: &[[u32; NEIGHBORS]], i: usize) -> impl Iterator<Item = usize> + Clone {
    near[i][..i.min(NEIGHBORS)].iter().map(|&index| index as usize)
}
