//! Surface nets.

use crate::blocks::{Around, CELLS, Place, cell};
use crate::{DistanceField, Mesh};
use rayon::prelude::*;

/// The corners of a cell: bit k of the index is the offset along axis k.
fn corner(cell: Place, index: usize) -> Place {
    std::array::from_fn(|axis| cell[axis] + (index >> axis & 1) as i32)
}

impl DistanceField {
    /// The surface where distances are 0, in cells all of whose corners were seen.
    pub fn mesh(&self) -> Mesh {
        nets(self)
    }
}

/// One vertex in each cell that the surface crosses, and a quadrilateral for each edge that it crosses.
fn nets(field: &DistanceField) -> Mesh {
    let DistanceField { voxel, blocks, cells, .. } = field;
    let value = |around: &Around, place: Place| -> Option<f32> {
        let (block, at) = around.find(place)?;
        let [distance, weight] = cells[block * CELLS + at];
        (weight > 0.0).then_some(distance)
    };
    // The vertex of each cell of a block, with its place.
    let vertices: Vec<Vec<(usize, [f32; 3])>> = blocks
        .par_iter()
        .map(|block| {
            let around = Around::new(blocks, *block);
            let vertex = |at: usize| {
                let own = cell(*block, at);
                let mut values = [0.0; 8];
                for (i, v) in values.iter_mut().enumerate() {
                    *v = value(&around, corner(own, i))?;
                }
                Some((at, crossing(&values)?.map(|x| x)))
                    .map(|(at, offset)| (at, std::array::from_fn(|k| ((f64::from(own[k]) + offset[k]) * voxel) as f32)))
            };
            (0..CELLS).filter_map(vertex).collect()
        })
        .collect();
    let mut index = vec![u32::MAX; blocks.len() * CELLS];
    let mut mesh = Mesh::default();
    for (block, own) in vertices.into_iter().enumerate() {
        for (at, vertex) in own {
            index[block * CELLS + at] = mesh.vertices.len() as u32;
            mesh.vertices.push(vertex);
        }
    }
    let faces: Vec<Vec<[u32; 3]>> = blocks
        .par_iter()
        .map(|block| {
            let around = Around::new(blocks, *block);
            let mut own = Vec::new();
            for at in 0..CELLS {
                let place = cell(*block, at);
                let Some(here) = value(&around, place) else { continue };
                for axis in 0..3 {
                    let Some(there) = value(&around, corner(place, 1 << axis)) else { continue };
                    if (here < 0.0) == (there < 0.0) {
                        continue;
                    }
                    // The four cells around the edge, counterclockwise seen against the axis.
                    let (u, v) = ((axis + 1) % 3, (axis + 2) % 3);
                    let quad = [[0, 0], [1, 0], [1, 1], [0, 1]].map(|[a, b]: [i32; 2]| {
                        let mut cell = place;
                        cell[u] -= a;
                        cell[v] -= b;
                        around.find(cell).map_or(u32::MAX, |(block, at)| index[block * CELLS + at])
                    });
                    if quad.contains(&u32::MAX) {
                        continue;
                    }
                    let [a, b, c, d] = quad;
                    // Distances are positive before the surface: its front is where they grow.
                    let [first, second] = if here < 0.0 { [[a, b, c], [a, c, d]] } else { [[a, c, b], [a, d, c]] };
                    own.extend([first, second]);
                }
            }
            own
        })
        .collect();
    mesh.triangles = faces.concat();
    mesh
}

/// The mean of the crossings of a cell's edges, in cells; none where all corners have one sign.
fn crossing(values: &[f32; 8]) -> Option<[f64; 3]> {
    let (mut sum, mut count) = ([0.0; 3], 0.0);
    for axis in 0..3 {
        for from in (0..8).filter(|i| i >> axis & 1 == 0) {
            let (a, b) = (f64::from(values[from]), f64::from(values[from | 1 << axis]));
            if (a < 0.0) == (b < 0.0) {
                continue;
            }
            for (k, sum) in sum.iter_mut().enumerate() {
                *sum += if k == axis { a / (a - b) } else { (from >> k & 1) as f64 };
            }
            count += 1.0;
        }
    }
    (count > 0.0).then(|| sum.map(|x| x / count))
}
