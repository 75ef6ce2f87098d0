//! Scaled dot-product attention, softmax(scale q k^T) v.
//!
//! Scores are computed tile by tile with an online softmax (Dao et al. 2022, arXiv 2205.14135), so that the matrix of
//! scores never exists as a whole.

use crate::extent::{extent, product};
use crate::gemm::{Mat, MatMut, gemm_serial};
use crate::lanes::{self, LANES, LaneKernel, LaneMask, Lanes};
use crate::parallel::{Interleaved, for_ranges};
use crate::softmax::maximum;
use crate::{Real, reduce};
use std::f64::consts::LOG2_E;

mod backward;
pub use backward::{AttentionOutput, attention_backward};

/// The most queries of a tile: keys and values are packed once for each tile.
const QUERIES: usize = 192;
/// Keys of a tile.
const KEYS: usize = 128;

/// The sizes of an attention: `batch` times `heads` independent problems.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct AttentionShape {
    /// Number of batch entries.
    pub batch: usize,
    /// Number of heads.
    pub heads: usize,
    /// Number of queries, and of output vectors.
    pub queries: usize,
    /// Number of keys, and of values.
    pub keys: usize,
    /// Length of a query, key, value or output vector.
    pub dim: usize,
}

/// The layout of a tensor of vectors: the vector of entry b, head h and token t begins at element
/// `b * batch + h * head + t * token` and is contiguous.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Strides {
    /// Distance between batch entries, in elements.
    pub batch: usize,
    /// Distance between heads, in elements.
    pub head: usize,
    /// Distance between tokens, in elements.
    pub token: usize,
}

impl Strides {
    /// The strides of a contiguous tensor `[batch, tokens, heads, dim]`.
    pub fn tokens_first(tokens: usize, heads: usize, dim: usize) -> Self {
        Self { batch: tokens * heads * dim, head: dim, token: heads * dim }
    }

    /// The strides of a contiguous tensor `[batch, heads, tokens, dim]`.
    pub fn heads_first(tokens: usize, heads: usize, dim: usize) -> Self {
        Self { batch: tokens * heads * dim, head: tokens * dim, token: dim }
    }

    /// Panics unless all vectors lie within `len` elements.
    fn check(self, shape: &AttentionShape, tokens: usize, len: usize, name: &str) {
        let reach = extent([(shape.batch, self.batch), (shape.heads, self.head), (tokens, self.token), (shape.dim, 1)]);
        let fits = reach.is_some_and(|reach| reach <= len);
        assert!(fits, "attention: {name} of {shape:?} with {self:?} has only {len} elements");
    }

    /// Panics if two vectors overlap.
    fn check_apart(self, shape: &AttentionShape, tokens: usize, name: &str) {
        let mut levels = [(self.batch, shape.batch), (self.head, shape.heads), (self.token, tokens)];
        levels.sort_unstable();
        let mut reach = shape.dim;
        for (stride, count) in levels {
            if count > 1 {
                assert!(stride >= reach, "attention: vectors of {name} of {shape:?} overlap with {self:?}");
                // On overflow the slice is too short as well, which is checked elsewhere.
                reach = stride.saturating_mul(count);
            }
        }
    }

    fn at(self, batch: usize, head: usize, token: usize) -> usize {
        batch * self.batch + head * self.head + token * self.token
    }
}

/// Inputs of attention: `q` holds `queries`, `k` and `v` hold `keys` vectors of length `dim` for every batch entry and
/// head.
#[derive(Clone, Copy, Debug)]
pub struct AttentionInputs<'a, T> {
    /// The sizes.
    pub shape: AttentionShape,
    /// Factor of every score; usually 1 / sqrt(dim).
    pub scale: T,
    /// Queries.
    pub q: (&'a [T], Strides),
    /// Keys.
    pub k: (&'a [T], Strides),
    /// Values.
    pub v: (&'a [T], Strides),
}

impl<T: Real> AttentionInputs<'_, T> {
    /// Panics if a slice is too short, or `lse` is not `[batch, heads, queries]`.
    fn check(&self, lse: &[T]) {
        let AttentionShape { batch, heads, queries, keys, .. } = self.shape;
        for ((x, strides), tokens, name) in [(self.q, queries, "q"), (self.k, keys, "k"), (self.v, keys, "v")] {
            strides.check(&self.shape, tokens, x.len(), name);
        }
        let expected = product([batch, heads, queries]);
        assert_eq!(Some(lse.len()), expected, "attention: length of lse of {:?}", self.shape);
    }
}

/// out = softmax(scale q k^T) v for every batch entry and head.
///
/// `out` receives as many vectors as there are queries. `lse` `[batch, heads, queries]` receives the binary logarithms
/// of the sums of exponentials, for [`attention_backward`]. Without keys the output is 0.
///
/// # Panics
///
/// If a slice is too short, or vectors of the output overlap.
///
/// ```
/// use weaver_kernels::attention::*;
/// let shape = AttentionShape { batch: 1, heads: 1, queries: 1, keys: 2, dim: 1 };
/// let at = Strides::heads_first(2, 1, 1);
/// let inputs = AttentionInputs { shape, scale: 1.0, q: (&[0.0], at), k: (&[5.0, 6.0], at), v: (&[1.0, 3.0], at) };
/// let (mut out, mut lse) = ([0.0], [0.0]);
/// attention_forward(&inputs, (&mut out, at), &mut lse);
/// assert_eq!((out, lse), ([2.0], [1.0])); // the mean of both values; 2^1 exponentials of 0
/// ```
#[inline(never)]
pub fn attention_forward<T: Real>(inputs: &AttentionInputs<T>, out: (&mut [T], Strides), lse: &mut [T]) {
    let AttentionInputs { shape, scale, q, k, v } = *inputs;
    let AttentionShape { batch, heads, queries, keys, dim } = shape;
    let (out, out_at) = out;
    inputs.check(lse);
    out_at.check(&shape, queries, out.len(), "the output");
    out_at.check_apart(&shape, queries, "the output");
    let (out, lse) = (Interleaved::new(out), Interleaved::new(lse));
    let block = tile_rows(queries);
    let blocks = queries.div_ceil(block.max(1));
    // Exponentials are powers of 2.
    let scale = scale * T::from_f64(LOG2_E);
    let task = |task: usize| {
        let (plane, first) = (task / blocks, task % blocks * block);
        let (b, h, rows) = (plane / heads, plane % heads, block.min(queries - first));
        T::with_scratch(rows * (LANES + KEYS + dim + 1), |scratch| {
            let (totals, rest) = scratch.split_at_mut(rows * LANES);
            let (scores, rest) = rest.split_at_mut(rows * KEYS);
            let (sums, tops) = rest.split_at_mut(rows * dim);
            tops.fill(-T::INFINITY);
            totals.fill(T::ZERO);
            sums.fill(T::ZERO);
            let q = Mat::new(&q.0[q.1.at(b, h, first)..], rows, dim).with_row_stride(q.1.token);
            for from in (0..keys).step_by(KEYS) {
                let n = KEYS.min(keys - from);
                let k = Mat::new(&k.0[k.1.at(b, h, from)..], n, dim).with_row_stride(k.1.token);
                let v = Mat::new(&v.0[v.1.at(b, h, from)..], n, dim).with_row_stride(v.1.token);
                let scores = &mut scores[..rows * n];
                gemm_serial(scale, q, k.transposed(), T::ZERO, MatMut::new(scores, rows, n));
                lanes::run(Absorb { n, dim, scores, sums, tops, totals });
                gemm_serial(T::ONE, Mat::new(scores, rows, n), v, T::ONE, MatMut::new(sums, rows, dim));
            }
            // SAFETY: no other task has these queries of this entry and head, and no two vectors of the output overlap.
            #[allow(unsafe_code)]
            let (lse, row) = unsafe {
                let lse = lse.slice(plane * queries + first, rows);
                (lse, |i: usize| out.slice(out_at.at(b, h, first + i), dim))
            };
            for i in 0..rows {
                let total = reduce::lanes([&totals[i * LANES..][..LANES]], |[x]| x);
                lse[i] = tops[i] + total.ln() * T::from_f64(LOG2_E);
                let norm = if keys > 0 { T::ONE / total } else { T::ZERO };
                for (out, sum) in row(i).iter_mut().zip(&sums[i * dim..][..dim]) {
                    *out = *sum * norm;
                }
            }
        });
    };
    for_ranges(batch * heads * blocks, 1, |range| range.for_each(task));
}

/// Queries of a tile, nearly equal in all tiles.
fn tile_rows(queries: usize) -> usize {
    queries.div_ceil(queries.div_ceil(QUERIES).max(1))
}

/// The online softmax for one tile of `n` keys: turns scores into powers of 2 relative to the maximum of each row so
/// far, adds them to the row's totals, and rescales earlier sums to the new maximum.
struct Absorb<'a, T> {
    n: usize,
    dim: usize,
    scores: &'a mut [T],
    sums: &'a mut [T],
    tops: &'a mut [T],
    totals: &'a mut [T],
}

impl<T: Real> LaneKernel<T> for Absorb<'_, T> {
    type Output = ();

    #[inline(always)]
    fn run<V: Lanes<Scalar = T>>(self) {
        let Self { n, dim, scores, sums, tops, totals } = self;
        let totals = totals.as_chunks_mut().0.iter_mut();
        for (i, (scores, (top, total))) in scores.chunks_exact_mut(n).zip(tops.iter_mut().zip(totals)).enumerate() {
            let (before, here) = (*top, maximum(scores));
            let mut sum = V::load(total);
            if here > before {
                *top = here;
                if before > -T::INFINITY {
                    let shrink = V::splat(before - here).exp2();
                    sum = sum * shrink;
                    lanes::map(
                        [],
                        &mut sums[i * dim..][..dim],
                        #[inline(always)]
                        |[], x: V| x * shrink,
                    );
                }
            }
            // If all scores so far are minus infinity, so is the maximum, and all weights are 0.
            let top = V::splat(if *top > -T::INFINITY { *top } else { T::ZERO });
            let (whole, rest) = scores.as_chunks_mut();
            for scores in whole {
                let weights = (V::load(scores) - top).exp2();
                weights.store(scores);
                sum = sum + weights;
            }
            if !rest.is_empty() {
                let weights = (lanes::at::<V>(rest, 0) - top).exp2().only(V::Mask::from_bits((1 << rest.len()) - 1));
                lanes::put(weights, rest, 0);
                sum = sum + weights;
            }
            sum.store(total);
        }
    }
}
