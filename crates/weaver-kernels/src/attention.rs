//! Scaled dot-product attention, softmax(scale q k^T) v, tile by tile with an online softmax
//! (Dao et al. 2022), so that the matrix of scores never exists as a whole.

use crate::extent::{extent, product};
use crate::gemm::{Mat, gemm_serial};
use crate::lanes::{self, LANES, LaneKernel, LaneMask, Lanes};
use crate::parallel::{Interleaved, for_ranges};
use crate::softmax::maximum;
use crate::{Real, reduce};
use std::f64::consts::LOG2_E;

mod backward;
pub use backward::attention_backward;

/// Queries of a tile at most: keys and values are packed once for so many.
const QUERIES: usize = 192;
/// Keys of a tile.
const KEYS: usize = 128;

/// The sizes of an attention: `batch` times `heads` independent ones.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Attention {
    /// Batch entries.
    pub batch: usize,
    /// Heads.
    pub heads: usize,
    /// Queries, and rows of the output.
    pub queries: usize,
    /// Keys and values.
    pub keys: usize,
    /// Length of a query, key or value.
    pub dim: usize,
}

/// Where the vectors of a tensor begin: entry b, head h, token t at `b batch + h head + t token`. The
/// vector itself is contiguous.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Strides {
    /// Between batch entries.
    pub batch: usize,
    /// Between heads.
    pub head: usize,
    /// Between tokens.
    pub token: usize,
}

impl Strides {
    /// `[batch, tokens, heads, dim]`.
    pub fn tokens_first(tokens: usize, heads: usize, dim: usize) -> Self {
        Self { batch: tokens * heads * dim, head: dim, token: heads * dim }
    }

    /// `[batch, heads, tokens, dim]`.
    pub fn heads_first(tokens: usize, heads: usize, dim: usize) -> Self {
        Self { batch: tokens * heads * dim, head: tokens * dim, token: dim }
    }

    /// Panics unless all vectors lie within `len` elements.
    fn check(self, size: &Attention, tokens: usize, len: usize, name: &str) {
        let reach = extent([(size.batch, self.batch), (size.heads, self.head), (tokens, self.token), (size.dim, 1)]);
        let fits = reach.is_some_and(|reach| reach <= len);
        assert!(fits, "attention: {name} of {size:?} with {self:?} has only {len} elements");
    }

    /// Panics unless the vectors are apart from each other.
    fn check_apart(self, size: &Attention, tokens: usize, name: &str) {
        let mut levels = [(self.batch, size.batch), (self.head, size.heads), (self.token, tokens)];
        levels.sort_unstable();
        let mut reach = size.dim;
        for (stride, count) in levels {
            if count > 1 {
                assert!(stride >= reach, "attention: vectors of {name} of {size:?} overlap with {self:?}");
                // What does not fit a number does not fit the slice either, which is checked.
                reach = stride.saturating_mul(count);
            }
        }
    }

    fn at(self, batch: usize, head: usize, token: usize) -> usize {
        batch * self.batch + head * self.head + token * self.token
    }
}

/// out = softmax(scale q k^T) v for every batch entry and head.
///
/// `q` and `out` hold `queries`, `k` and `v` hold `keys` vectors of length `dim` per entry and head,
/// laid out by their [`Strides`]. `lse` `[batch, heads, queries]` receives the binary logarithms of the sums of
/// exponentials, for the gradients. Without keys the output is 0. Panics if a slice is too short.
pub fn attention_forward<T: Real>(
    size: &Attention,
    scale: T,
    q: (&[T], Strides),
    k: (&[T], Strides),
    v: (&[T], Strides),
    out: (&mut [T], Strides),
    lse: &mut [T],
) {
    let Attention { heads, queries, keys, dim, .. } = *size;
    let (out, out_at) = out;
    q.1.check(size, queries, q.0.len(), "q");
    k.1.check(size, keys, k.0.len(), "k");
    v.1.check(size, keys, v.0.len(), "v");
    out_at.check(size, queries, out.len(), "the output");
    out_at.check_apart(size, queries, "the output");
    assert_eq!(Some(lse.len()), product([size.batch, heads, queries]), "attention: length of lse of {size:?}");
    let (out, lse) = (Interleaved::new(out), Interleaved::new(lse));
    let block = tile_rows(queries);
    let blocks = queries.div_ceil(block.max(1));
    // Scores are in powers of 2.
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
            let q = Mat::new(&q.0[q.1.at(b, h, first)..], q.1.token);
            for from in (0..keys).step_by(KEYS) {
                let n = KEYS.min(keys - from);
                let k = Mat::new(&k.0[k.1.at(b, h, from)..], k.1.token).transposed();
                let v = Mat::new(&v.0[v.1.at(b, h, from)..], v.1.token);
                let scores = &mut scores[..rows * n];
                gemm_serial(rows, n, dim, scale, q, k, T::ZERO, scores, n);
                lanes::run(Absorb { n, dim, scores, sums, tops, totals });
                gemm_serial(rows, dim, n, T::ONE, Mat::new(scores, n), v, T::ONE, sums, dim);
            }
            // SAFETY: this task alone has these queries of this entry and head, and no two vectors of
            // the output overlap.
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
    for_ranges(size.batch * heads * blocks, 1, |range| range.for_each(task));
}

/// Queries of a tile: nearly the same in all.
fn tile_rows(queries: usize) -> usize {
    queries.div_ceil(queries.div_ceil(QUERIES).max(1))
}

/// Turns scores of `n` keys into powers of 2 relative to each row's maximum so far, adds them to the totals, a vector for each
/// row, and scales what was summed relative to an earlier maximum.
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
            // Where all scores so far are minus infinity, so is the maximum, and weights are 0.
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
