//! Differences of queries and keys of neighbors, from which the attention's scores are computed.

use crate::neighbors::{GRAIN, Neighbors};
use weaver_autograd::{Backward, Op, Pool, Real, Shape, ShapeError, Shapes, Var, View, ViewMut, ensure_shape};
use weaver_kernels::parallel;

#[derive(Debug)]
struct NeighborRelation {
    neighbors: Neighbors,
}

impl<T: Real> Op<T> for NeighborRelation {
    fn name(&self) -> &'static str {
        "neighbor_relation"
    }

    fn shapes(&self, ins: &[Shape]) -> Result<Shapes, ShapeError> {
        let (n, pairs) = (self.neighbors.among(), self.neighbors.index().len());
        let c = ins[0].last();
        ensure_shape!(
            ins.len() == 3 && c > 0 && ins[0] == Shape::from([n, c]) && ins[1] == ins[0] && ins[2] == [pairs, c].into(),
            "queries and keys [{n}, C] and displacements [{pairs}, C]"
        );
        Ok(Shapes::one(ins[2]))
    }

    fn forward(&mut self, ins: &[View<'_, T>], outs: &mut [ViewMut<'_, T>], _pool: &Pool) {
        let (query, key, displacement) = (ins[0], ins[1], ins[2]);
        let (m, c) = (self.neighbors.per_gaussian(), query.shape().last());
        parallel::for_chunks(&mut outs[0], GRAIN * m * c, |chunk, out| {
            for (row, relations) in out.chunks_exact_mut(m * c).enumerate() {
                let row = chunk * GRAIN + row;
                let i = self.neighbors.first() + row;
                let query = &query[i * c..(i + 1) * c];
                let displacements = displacement[row * m * c..(row + 1) * m * c].chunks_exact(c);
                for ((relation, d), &j) in relations.chunks_exact_mut(c).zip(displacements).zip(self.neighbors.of(row))
                {
                    let key = &key[j as usize * c..(j as usize + 1) * c];
                    for (((r, q), k), d) in relation.iter_mut().zip(query).zip(key).zip(d) {
                        *r = *q - *k + *d;
                    }
                }
            }
        });
    }

    fn backward(&self, at: Backward<'_, '_, T>) {
        let Backward { ins, douts, dins, .. } = at;
        let drelation = douts[0];
        let (m, c) = (self.neighbors.per_gaussian(), ins[0].shape().last());
        let [dquery, dkey, ddisplacement] = dins else { unreachable!("three inputs") };
        if let Some(dquery) = dquery {
            parallel::for_chunks(dquery.accumulator(), GRAIN * c, |chunk, out| {
                for (row, dq) in out.chunks_exact_mut(c).enumerate() {
                    let Some(row) = self.neighbors.own(chunk * GRAIN + row) else { continue };
                    for dr in drelation[row * m * c..(row + 1) * m * c].chunks_exact(c) {
                        dq.iter_mut().zip(dr).for_each(|(dq, dr)| *dq += *dr);
                    }
                }
            });
        }
        if let Some(dkey) = dkey {
            parallel::for_chunks(dkey.accumulator(), GRAIN * c, |chunk, out| {
                for (row, dk) in out.chunks_exact_mut(c).enumerate() {
                    for at in self.neighbors.naming(chunk * GRAIN + row) {
                        let dr = &drelation[at * c..(at + 1) * c];
                        dk.iter_mut().zip(dr).for_each(|(dk, dr)| *dk -= *dr);
                    }
                }
            });
        }
        if let Some(ddisplacement) = ddisplacement {
            ddisplacement.add(&drelation);
        }
    }
}

/// The relation q_i - k_j + d_ij of every Gaussian i that has a list to its neighbors j, per channel.
///
/// `query` and `key` `[N, C]` and `displacement` d `[R m, C]` are differentiable, the neighbors constant; the result
/// is `[R m, C]`, m rows per list. Linear. Panics on other shapes. Source: Zhao et al., Point Transformer, ICCV
/// 2021, eq. 3.
#[track_caller]
pub fn neighbor_relation<'t, T: Real>(
    query: Var<'t, T>,
    key: Var<'t, T>,
    displacement: Var<'t, T>,
    neighbors: &Neighbors,
) -> Var<'t, T> {
    let op = NeighborRelation { neighbors: neighbors.clone() };
    let [relation] = query.tape().apply(op, &[query, key, displacement]);
    relation
}
