//! The softmax-weighted average over a Gaussian's neighbors, with separate weights per channel.

use crate::neighbors::{GRAIN, Neighbors};
use weaver_autograd::{Backward, Op, Pool, Real, Shape, ShapeError, Shapes, Var, View, ViewMut, ensure_shape};
use weaver_kernels::{parallel, simd};

#[derive(Debug)]
struct NeighborAverage {
    neighbors: Neighbors,
}

/// Softmax over the `m` rows of `scores` `[m, C]`, for each of the C columns.
#[inline(always)]
fn softmax_columns<T: Real>(scores: &[T], weights: &mut [T], largest: &mut [T], sum: &mut [T]) {
    let c = largest.len();
    largest.copy_from_slice(&scores[..c]);
    for row in scores.chunks_exact(c) {
        largest.iter_mut().zip(row).for_each(|(l, s)| *l = if *s > *l { *s } else { *l });
    }
    sum.fill(T::ZERO);
    for (weight, score) in weights.chunks_exact_mut(c).zip(scores.chunks_exact(c)) {
        for (((w, s), l), sum) in weight.iter_mut().zip(score).zip(largest.iter()).zip(sum.iter_mut()) {
            *w = (*s - *l).exp();
            *sum += *w;
        }
    }
    for weight in weights.chunks_exact_mut(c) {
        weight.iter_mut().zip(sum.iter()).for_each(|(w, sum)| *w /= *sum);
    }
}

impl<T: Real> Op<T> for NeighborAverage {
    fn name(&self) -> &'static str {
        "neighbor_average"
    }

    fn shapes(&self, ins: &[Shape]) -> Result<Shapes, ShapeError> {
        let (n, pairs) = (self.neighbors.among(), self.neighbors.index().len());
        let c = ins[1].last();
        ensure_shape!(
            ins.len() == 3 && c > 0 && ins[1] == Shape::from([n, c]) && ins[0] == [pairs, c].into() && ins[2] == ins[0],
            "scores and displacements [{pairs}, C] and values [{n}, C]"
        );
        Ok(Shapes::one([self.neighbors.len(), c]).and(ins[0]))
    }

    fn auxiliary_outputs(&self) -> usize {
        1
    }

    fn forward(&mut self, ins: &[View<'_, T>], outs: &mut [ViewMut<'_, T>], pool: &Pool) {
        let (score, value, displacement) = (ins[0], ins[1], ins[2]);
        let (m, c) = (self.neighbors.per_gaussian(), value.shape().last());
        let [average, weight] = outs else { unreachable!("two outputs") };
        parallel::for_chunks(weight, GRAIN * m * c, |chunk, out| {
            let mut columns = pool.buffer::<T>(2 * c);
            simd::dispatch(
                #[inline(always)]
                || {
                    let (largest, sum) = columns.split_at_mut(c);
                    for (row, weights) in out.chunks_exact_mut(m * c).enumerate() {
                        let at = (chunk * GRAIN + row) * m * c;
                        softmax_columns(&score[at..at + m * c], weights, largest, sum);
                    }
                },
            );
        });
        let weight: &[T] = weight;
        parallel::for_chunks(average, GRAIN * c, |chunk, out| {
            for (row, average) in out.chunks_exact_mut(c).enumerate() {
                let i = chunk * GRAIN + row;
                let block = i * m * c..(i + 1) * m * c;
                let pairs = weight[block.clone()].chunks_exact(c).zip(displacement[block].chunks_exact(c));
                average.fill(T::ZERO);
                for ((w, d), &j) in pairs.zip(self.neighbors.of(i)) {
                    let value = &value[j as usize * c..(j as usize + 1) * c];
                    for (((z, w), d), v) in average.iter_mut().zip(w).zip(d).zip(value) {
                        *z += *w * (*v + *d);
                    }
                }
            }
        });
    }

    fn backward(&self, at: Backward<'_, '_, T>) {
        let Backward { ins, outs, douts, dins, .. } = at;
        let (value, displacement) = (ins[1], ins[2]);
        let (average, weight, daverage) = (outs[0], outs[1], douts[0]);
        let (m, c) = (self.neighbors.per_gaussian(), value.shape().last());
        let [dscore, dvalue, ddisplacement] = dins else { unreachable!("three inputs") };
        if let Some(dscore) = dscore {
            // da_ij = w_ij dz_i (v_j + d_ij - z_i)
            parallel::for_chunks(dscore.accumulator(), GRAIN * m * c, |chunk, out| {
                for (pair, ds) in out.chunks_exact_mut(c).enumerate() {
                    let at = chunk * GRAIN * m + pair;
                    let (i, j) = (at / m, self.neighbors.index()[at] as usize);
                    for a in 0..c {
                        let apart = value[j * c + a] + displacement[at * c + a] - average[i * c + a];
                        ds[a] += weight[at * c + a] * daverage[i * c + a] * apart;
                    }
                }
            });
        }
        if let Some(dvalue) = dvalue {
            parallel::for_chunks(dvalue.accumulator(), GRAIN * c, |chunk, out| {
                for (row, dv) in out.chunks_exact_mut(c).enumerate() {
                    for at in self.neighbors.naming(chunk * GRAIN + row) {
                        let i = at / m;
                        let (w, dz) = (&weight[at * c..(at + 1) * c], &daverage[i * c..(i + 1) * c]);
                        dv.iter_mut().zip(w).zip(dz).for_each(|((dv, w), dz)| *dv += *w * *dz);
                    }
                }
            });
        }
        if let Some(ddisplacement) = ddisplacement {
            parallel::for_chunks(ddisplacement.accumulator(), GRAIN * m * c, |chunk, out| {
                for (pair, dd) in out.chunks_exact_mut(c).enumerate() {
                    let at = chunk * GRAIN * m + pair;
                    let (w, dz) = (&weight[at * c..(at + 1) * c], &daverage[at / m * c..(at / m + 1) * c]);
                    dd.iter_mut().zip(w).zip(dz).for_each(|((dd, w), dz)| *dd += *w * *dz);
                }
            });
        }
    }
}

/// The attention over neighbors: each Gaussian's softmax-weighted average of its neighbors' values.
///
/// z_i = sum_j w_ij (v_j + d_ij), where w_ij is the softmax of the scores a_ij over the neighbors j of i, separately
/// per channel.
///
/// `score` a and `displacement` d `[R m, C]`, m rows per list, and `value` v `[N, C]` are differentiable, the
/// neighbors constant; the result is `[R, C]`. Panics on other shapes. Source: Zhao et al., Point Transformer, ICCV
/// 2021, eq. 3.
#[track_caller]
pub fn neighbor_average<'t, T: Real>(
    score: Var<'t, T>,
    value: Var<'t, T>,
    displacement: Var<'t, T>,
    neighbors: &Neighbors,
) -> Var<'t, T> {
    let op = NeighborAverage { neighbors: neighbors.clone() };
    let [average, _weight] = score.tape().apply(op, &[score, value, displacement]);
    average
}
