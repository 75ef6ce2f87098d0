//! Neighbors that a decoder knows already.

use crate::morton::from_morton3;
use rayon::prelude::*;

/// Gaussians before one in Morton order among which its neighbors are looked for.
const WINDOW: usize = 24;

/// Neighbors of a Gaussian at most.
pub(super) const NEIGHBORS: usize = 3;

/// The nearest of the Gaussians shortly before each one in Morton order, the nearest first; itself where there are too few.
pub(super) fn neighbors(voxels: &[u64]) -> Vec<[u32; NEIGHBORS]> {
    let places: Vec<[i64; 3]> = voxels.iter().map(|&voxel| from_morton3(voxel).map(i64::from)).collect();
    let nearest = |i: usize| {
        let mut found = [(i64::MAX, i as u32); NEIGHBORS];
        for before in i.saturating_sub(WINDOW)..i {
            let distance = (0..3).map(|axis| (places[before][axis] - places[i][axis]).pow(2)).sum();
            let mut entry = (distance, before as u32);
            for place in &mut found {
                if entry.0 < place.0 {
                    std::mem::swap(place, &mut entry);
                }
            }
        }
        found.map(|(_, index)| index)
    };
    (0..voxels.len()).into_par_iter().map(nearest).collect()
}

/// The neighbors of one Gaussian that are not itself.
pub(super) fn known(near: &[u32; NEIGHBORS], i: usize) -> impl Iterator<Item = usize> + Clone + use<> {
    let near = *near;
    near.into_iter().map(|index| index as usize).filter(move |&index| index != i)
}
