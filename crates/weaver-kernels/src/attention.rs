//! Scaled dot-product attention, softmax(scale q k^T) v, tile by tile with an online softmax
//! (Dao et al. 2022), so that the matrix of scores never exists as a whole.

use crate::gemm::{Mat, gemm_serial};
use crate::parallel::{Interleaved, for_ranges};
use crate::reduce::lanes;
use crate::softmax::maximum;
use crate::{Real, simd};

mod backward;
pub use backward::{attention_backward, attention_backward_packed};

/// Queries of a tile.
const QUERIES: usize = 64;
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

    /// One of the three parts of `[batch, tokens, 3, heads, dim]`; pass slices that begin 0, `heads dim`
    /// and `2 heads dim` elements into the buffer.
    pub fn packed(tokens: usize, heads: usize, dim: usize) -> Self {
        Self { batch: 3 * tokens * heads * dim, head: dim, token: 3 * heads * dim }
    }

    /// Panics unless all vectors lie within `len` elements.
    fn check(self, size: &Attention, tokens: usize, len: usize, name: &str) {
        let last = |n: usize, stride: usize| n.saturating_sub(1) * stride;
        let end = last(size.batch, self.batch) + last(size.heads, self.head) + last(tokens, self.token) + size.dim;
        let empty = size.batch == 0 || size.heads == 0 || tokens == 0;
        assert!(empty || end <= len, "attention: {name} of {size:?} with {self:?} has only {len} elements");
    }

    /// Panics unless the vectors are apart from each other.
    fn check_apart(self, size: &Attention, tokens: usize, name: &str) {
        let mut levels = [(self.batch, size.batch), (self.head, size.heads), (self.token, tokens)];
        levels.sort_unstable();
        let mut reach = size.dim;
        for (stride, count) in levels {
            if count > 1 {
                assert!(stride >= reach, "attention: vectors of {name} of {size:?} overlap with {self:?}");
                reach = stride * count;
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
/// laid out by their [`Strides`]. `lse` `[batch, heads, queries]` receives the logarithms of the sums of
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
    assert_eq!(lse.len(), size.batch * heads * queries, "attention: length of lse of {size:?}");
    let (out, lse) = (Interleaved::new(out), Interleaved::new(lse));
    let blocks = queries.div_ceil(QUERIES);
    let task = |task: usize| {
        let (plane, first) = (task / blocks, task % blocks * QUERIES);
        let (b, h, rows) = (plane / heads, plane % heads, QUERIES.min(queries - first));
        T::with_scratch(rows * (KEYS + dim + 2), |scratch| {
            let (scores, rest) = scratch.split_at_mut(rows * KEYS);
            let (sums, rest) = rest.split_at_mut(rows * dim);
            let (tops, totals) = rest.split_at_mut(rows);
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
                simd::dispatch(
                    #[inline(always)]
                    || absorb(n, scores, dim, sums, tops, totals),
                );
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
                lse[i] = tops[i] + totals[i].ln();
                let norm = if totals[i] > T::ZERO { T::ONE / totals[i] } else { T::ZERO };
                for (out, sum) in row(i).iter_mut().zip(&sums[i * dim..][..dim]) {
                    *out = *sum * norm;
                }
            }
        });
    };
    for_ranges(size.batch * heads * blocks, 1, |range| range.for_each(task));
}

/// Turns scores into exponentials relative to each row's maximum so far, and rescales what was summed
/// relative to an earlier maximum.
#[inline(always)]
fn absorb<T: Real>(n: usize, scores: &mut [T], dim: usize, sums: &mut [T], tops: &mut [T], totals: &mut [T]) {
    for (i, scores) in scores.chunks_exact_mut(n).enumerate() {
        let here = maximum(scores);
        let top = if here > tops[i] { here } else { tops[i] };
        if top > tops[i] && totals[i] > T::ZERO {
            let shrink = (tops[i] - top).exp();
            totals[i] *= shrink;
            sums[i * dim..][..dim].iter_mut().for_each(|s| *s *= shrink);
        }
        tops[i] = top;
        scores.iter_mut().for_each(|s| *s = (*s - top).exp());
        totals[i] += lanes([&*scores], |[s]| s);
    }
}
