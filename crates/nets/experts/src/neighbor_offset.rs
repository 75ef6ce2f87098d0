//! Offsets from each Gaussian to its neighbors.

use crate::neighbors::{GRAIN, Neighbors};
use weaver_autograd::{Backward, Op, Pool, Real, Shape, ShapeError, Shapes, Var, View, ViewMut, ensure_shape};
use weaver_kernels::parallel;

#[derive(Debug)]
struct NeighborOffset {
    neighbors: Neighbors,
}

impl<T: Real> Op<T> for NeighborOffset {
    fn name(&self) -> &'static str {
        "neighbor_offset"
    }

    fn shapes(&self, ins: &[Shape]) -> Result<Shapes, ShapeError> {
        let n = self.neighbors.among();
        ensure_shape!(ins.len() == 1 && ins[0] == Shape::from([n, 3]), "means [{n}, 3]");
        Ok(Shapes::one([self.neighbors.index().len(), 3]))
    }

    fn forward(&mut self, ins: &[View<'_, T>], outs: &mut [ViewMut<'_, T>], _pool: &Pool) {
        let means = ins[0];
        let m = self.neighbors.per_gaussian();
        parallel::for_chunks(&mut outs[0], GRAIN * m * 3, |chunk, out| {
            for (row, offsets) in out.chunks_exact_mut(m * 3).enumerate() {
                let row = chunk * GRAIN + row;
                let i = self.neighbors.first() + row;
                for (offset, &j) in offsets.chunks_exact_mut(3).zip(self.neighbors.of(row)) {
                    for a in 0..3 {
                        offset[a] = means[3 * j as usize + a] - means[3 * i + a];
                    }
                }
            }
        });
    }

    fn backward(&self, at: Backward<'_, '_, T>) {
        let Backward { douts, dins, .. } = at;
        let Some(dmeans) = &mut dins[0] else { return };
        let doffset = douts[0];
        let m = self.neighbors.per_gaussian();
        parallel::for_chunks(dmeans.accumulator(), GRAIN * 3, |chunk, out| {
            for (row, dmean) in out.chunks_exact_mut(3).enumerate() {
                let j = chunk * GRAIN + row;
                for at in self.neighbors.naming(j) {
                    for a in 0..3 {
                        dmean[a] += doffset[3 * at + a];
                    }
                }
                let Some(row) = self.neighbors.own(j) else { continue };
                for own in doffset[3 * row * m..3 * (row + 1) * m].chunks_exact(3) {
                    for a in 0..3 {
                        dmean[a] -= own[a];
                    }
                }
            }
        });
    }
}

/// The offsets r_ij = mu_j - mu_i from every Gaussian i that has a list to its neighbors j.
///
/// `means` `[N, 3]` are differentiable; the neighbors are constant; the result is `[R m, 3]`, m rows per list. Linear.
/// Panics if the neighbors do not belong to N Gaussians. Source: Zhao et al., Point Transformer, ICCV 2021, eq. 4.
#[track_caller]
pub fn neighbor_offset<'t, T: Real>(means: Var<'t, T>, neighbors: &Neighbors) -> Var<'t, T> {
    let [offset] = means.tape().apply(NeighborOffset { neighbors: neighbors.clone() }, &[means]);
    offset
}
