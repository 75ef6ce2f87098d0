//! Fields that are known everywhere, whose surface is closed.

use crate::blocks::{CELLS, Place, SIDE, cell, split};
use crate::field::{MOST_BLOCKS, distance};
use crate::{DistanceField, MeshError, RangeView};
use rayon::prelude::*;
use std::collections::HashMap;
use weaver_geometry::glam::DVec3;

/// The most nodes of the coarse grid.
const MOST_NODES: usize = 1 << 21;
/// Nodes around the blocks; the outermost are empty space.
const MARGIN: i32 = 2;
/// Rounds of averaging at each level of the coarse grid, and at the cells beside known ones.
const ROUNDS: usize = 40;
const CELL_ROUNDS: usize = 12;
/// Lattice points of a block with one more on every side, in a row.
const PADDED: i32 = SIDE + 2;

impl DistanceField {
    /// The field with distances where nothing was seen, too, so that its surface is closed: every edge of
    /// [`mesh`](Self::mesh) has two triangles for each sheet, and [`Mesh::manifold`](crate::Mesh::manifold) makes it a
    /// 2-manifold.
    ///
    /// Unseen space takes the harmonic interpolation between known distances, 1 where a view looks through and at the
    /// border of a box around everything, on a grid of blocks; beside known cells, on the grid of cells. A sheet that
    /// was seen from one side alone becomes a slab.
    /// Source: Davis et al., "Filling holes in complex surfaces using volumetric diffusion", 2002.
    ///
    /// # Errors
    /// [`MeshError::TooMany`] where the closed surface has too many blocks.
    pub fn closed(&self, views: &[RangeView<'_>]) -> Result<Self, MeshError> {
        if self.blocks.is_empty() {
            return Ok(self.clone());
        }
        let coarse = Coarse::new(self, views);
        let mut closed = self.filled(&coarse);
        let mut places: HashMap<Place, usize> = closed.blocks.iter().enumerate().map(|(i, b)| (*b, i)).collect();
        let mut fresh = closed.blocks.clone();
        while !fresh.is_empty() {
            let reached: Vec<Vec<Place>> = fresh.par_iter().map(|b| closed.reached(*b, &places, &coarse)).collect();
            fresh = reached.concat();
            fresh.par_sort_unstable();
            fresh.dedup();
            fresh.retain(|block| !places.contains_key(block));
            if closed.blocks.len() + fresh.len() > MOST_BLOCKS {
                return Err(MeshError::TooMany { voxel: self.voxel });
            }
            places.extend(fresh.iter().enumerate().map(|(i, block)| (*block, closed.blocks.len() + i)));
            closed.blocks.extend(&fresh);
            let value = |i: usize| [coarse.value(cell(fresh[i / CELLS], i % CELLS)), 1.0];
            closed.cells.par_extend((0..fresh.len() * CELLS).into_par_iter().map(value));
        }
        let mut order: Vec<usize> = (0..closed.blocks.len()).collect();
        order.sort_unstable_by_key(|i| closed.blocks[*i]);
        let cells = order.iter().flat_map(|i| &closed.cells[i * CELLS..(i + 1) * CELLS]).copied().collect();
        Ok(Self { blocks: order.iter().map(|i| closed.blocks[*i]).collect(), cells, ..closed })
    }

    /// The same blocks without unknown cells.
    fn filled(&self, coarse: &Coarse) -> Self {
        let at = |i: usize| cell(self.blocks[i / CELLS], i % CELLS);
        let first = |i: usize| [if self.cells[i][1] > 0.0 { self.cells[i][0] } else { coarse.value(at(i)) }, 1.0];
        let mut cells: Vec<[f32; 2]> = (0..self.cells.len()).into_par_iter().map(first).collect();
        let places: HashMap<Place, usize> = self.blocks.iter().enumerate().map(|(i, b)| (*b, i)).collect();
        let unknown: Vec<usize> = (0..cells.len()).filter(|i| self.cells[*i][1] <= 0.0).collect();
        for _ in 0..CELL_ROUNDS {
            let value = |place: Place| {
                let (block, at) = split(place);
                places.get(&block).map_or_else(|| coarse.value(place), |i| cells[i * CELLS + at][0])
            };
            let mean = |i: &usize| {
                let around = (0..6).map(|k| {
                    let mut place = at(*i);
                    place[k / 2] += if k % 2 == 0 { -1 } else { 1 };
                    value(place)
                });
                around.sum::<f32>() / 6.0
            };
            let means: Vec<f32> = unknown.par_iter().map(mean).collect();
            unknown.iter().zip(means).for_each(|(i, mean)| cells[*i][0] = mean);
        }
        Self { cells, ..self.clone() }
    }

    /// The blocks beside one that edges of cells need which its surface crosses.
    fn reached(&self, block: Place, places: &HashMap<Place, usize>, coarse: &Coarse) -> Vec<Place> {
        let beside = |i: usize| -> Place {
            let offset = [i % 3, i / 3 % 3, i / 9].map(|x| x as i32 - 1);
            std::array::from_fn(|k| block[k] + offset[k])
        };
        let known: [Option<&usize>; 27] = std::array::from_fn(|i| places.get(&beside(i)));
        if known.iter().all(Option::is_some) {
            return Vec::new();
        }
        // The sign at a point from -1 to 8 along each axis.
        let points = 0..PADDED * PADDED * PADDED;
        let point = |i: i32| [i % PADDED - 1, i / PADDED % PADDED - 1, i / PADDED / PADDED - 1];
        let of = |p: Place| p.iter().rev().fold(0, |sum, x| 3 * sum + (x.div_euclid(SIDE) + 1) as usize);
        let inside: Vec<bool> = points
            .map(|i| {
                let within = point(i);
                let place = std::array::from_fn(|k| SIDE * block[k] + within[k]);
                let known = known[of(within)].map(|i| self.cells[i * CELLS + split(place).1][0]);
                known.unwrap_or_else(|| coarse.value(place)) < 0.0
            })
            .collect();
        let at = |p: Place| inside[((p[2] + 1) * PADDED * PADDED + (p[1] + 1) * PADDED + p[0] + 1) as usize];
        let mut reached = [false; 27];
        for i in 0..CELLS {
            let p = [i % 8, i / 8 % 8, i / 64].map(|x| x as i32);
            for k in 0..6 {
                let mut other = p;
                other[k / 2] += if k % 2 == 0 { -1 } else { 1 };
                if at(p) == at(other) {
                    continue;
                }
                // All corners of the four cells around the edge.
                for corner in 0..27 {
                    let offset = [corner % 3, corner / 3 % 3, corner / 9].map(|x| x - 1);
                    let corner = std::array::from_fn(|axis| {
                        if axis == k / 2 {
                            p[axis].min(other[axis]) + (offset[axis] + 1) / 2
                        } else {
                            p[axis] + offset[axis]
                        }
                    });
                    reached[of(corner)] = true;
                }
            }
        }
        (0..27).filter(|i| reached[*i] && known[*i].is_none()).map(beside).collect()
    }
}

/// Distances in parts of the truncation, at the centers of cubes of blocks.
struct Coarse {
    /// The lowest node, in cubes.
    low: Place,
    size: [usize; 3],
    /// Cells along a cube's side.
    side: i32,
    values: Vec<f32>,
    truncation: f64,
}

impl Coarse {
    fn new(field: &DistanceField, views: &[RangeView<'_>]) -> Self {
        let of = |side: i32| {
            let range = |k: usize| {
                let at = || field.blocks.iter().map(|block| (block[k] * SIDE).div_euclid(side));
                (at().min().unwrap_or(0) - MARGIN, at().max().unwrap_or(0) + MARGIN)
            };
            let ranges = [range(0), range(1), range(2)];
            (ranges.map(|r| r.0), ranges.map(|r| (r.1 - r.0 + 1) as usize))
        };
        let sides = std::iter::successors(Some(SIDE), |side| Some(2 * side));
        let (side, (low, size)) = sides
            .map(|side| (side, of(side)))
            .find(|(_, (_, size))| size.iter().product::<usize>() <= MOST_NODES)
            .unwrap_or((SIDE, of(SIDE)));
        let mut coarse = Self { low, size, side, values: Vec::new(), truncation: field.truncation };
        // Sums and numbers of known cells.
        let mut sums = vec![[0.0_f64, 0.0]; size.iter().product()];
        for (block, cells) in field.blocks.iter().zip(field.cells.chunks(CELLS)) {
            let sum = &mut sums[coarse.node(block.map(|x| (x * SIDE).div_euclid(side)))];
            for [distance, _] in cells.iter().filter(|cell| cell[1] > 0.0) {
                *sum = [sum[0] + f64::from(*distance) / field.truncation, sum[1] + 1.0];
            }
        }
        let fixed = |i: usize| {
            let at = [i % size[0], i / size[0] % size[1], i / size[0] / size[1]];
            if (0..3).any(|k| at[k] == 0 || at[k] + 1 == size[k]) {
                return Some(1.0);
            }
            let [sum, count] = sums[i];
            if count > 0.0 {
                return Some((sum / count).clamp(-1.0, 1.0) as f32);
            }
            let node = DVec3::from_array(std::array::from_fn(|k| f64::from(low[k] + at[k] as i32) + 0.5));
            let point = node * (f64::from(side) * field.voxel);
            let through = |view: &RangeView<'_>| {
                distance(view, point, field.truncation).is_some_and(|[distance, _]| distance >= field.truncation)
            };
            views.iter().any(through).then_some(1.0)
        };
        let fixed: Vec<Option<f32>> = (0..sums.len()).into_par_iter().map(fixed).collect();
        coarse.values = harmonic(&fixed, size);
        coarse
    }

    /// The index of a node within the grid.
    fn node(&self, at: Place) -> usize {
        let [x, y, z]: [usize; 3] = std::array::from_fn(|k| (at[k] - self.low[k]) as usize);
        (z * self.size[1] + y) * self.size[0] + x
    }

    /// The distance at the lower corner of a cell, linear between the eight nodes around it; empty space beyond
    /// the grid.
    fn value(&self, cell: Place) -> f32 {
        let at = DVec3::from_array(cell.map(f64::from)) / f64::from(self.side) - 0.5;
        let corner = at.floor();
        let part = at - corner;
        let corner = corner.to_array().map(|x| x as i32);
        if (0..3).any(|k| corner[k] < self.low[k] || corner[k] + 1 >= self.low[k] + self.size[k] as i32) {
            return self.truncation as f32;
        }
        let node = |i: usize| {
            let offset = [i & 1, i >> 1 & 1, i >> 2];
            let weight: f64 = (0..3).map(|k| if offset[k] == 1 { part[k] } else { 1.0 - part[k] }).product();
            weight * f64::from(self.values[self.node(std::array::from_fn(|k| corner[k] + offset[k] as i32))])
        };
        ((0..8).map(node).sum::<f64>() * self.truncation) as f32
    }
}

/// The values of a grid `[z, y, x]` that are the means of the six around them wherever none is fixed, about: from a
/// grid of half the size on, some rounds of averaging each.
fn harmonic(fixed: &[Option<f32>], size: [usize; 3]) -> Vec<f32> {
    let place = |i: usize, size: [usize; 3]| [i % size[0], i / size[0] % size[1], i / size[0] / size[1]];
    let index = |[x, y, z]: [usize; 3], size: [usize; 3]| (z * size[1] + y) * size[0] + x;
    let mut values: Vec<f32> = if size.iter().all(|side| *side < 4) {
        fixed.iter().map(|value| value.unwrap_or(0.0)).collect()
    } else {
        let half = size.map(|side| side.div_ceil(2));
        let mean = |i: usize| {
            let low = place(i, half).map(|x| 2 * x);
            let eight = (0..8).map(|k| [low[0] + (k & 1), low[1] + (k >> 1 & 1), low[2] + (k >> 2)]);
            let inside = eight.filter(|at| (0..3).all(|k| at[k] < size[k]));
            let known: Vec<f32> = inside.filter_map(|at| fixed[index(at, size)]).collect();
            (!known.is_empty()).then(|| known.iter().sum::<f32>() / known.len() as f32)
        };
        let coarse = harmonic(&(0..half.iter().product()).map(mean).collect::<Vec<_>>(), half);
        let from = |i: usize| fixed[i].unwrap_or_else(|| coarse[index(place(i, size).map(|x| x / 2), half)]);
        (0..fixed.len()).map(from).collect()
    };
    for _ in 0..ROUNDS {
        let mean = |i: usize| {
            fixed[i].unwrap_or_else(|| {
                let at = place(i, size);
                let step = [1, size[0], size[0] * size[1]];
                let sides = (0..3).map(|k| {
                    let low = if at[k] > 0 { values[i - step[k]] } else { values[i] };
                    low + if at[k] + 1 < size[k] { values[i + step[k]] } else { values[i] }
                });
                sides.sum::<f32>() / 6.0
            })
        };
        values = (0..fixed.len()).into_par_iter().map(mean).collect();
    }
    values
}
