//! Gradients of attention: scores are computed again, tile by tile.

use super::{Attention, KEYS, Strides, tile_rows};
use crate::extent::product;
use crate::gemm::{Mat, gemm_serial};
use crate::lanes::{self, LaneKernel, Lanes};
use crate::parallel::{Interleaved, for_ranges};
use crate::target::{Target, put};
use crate::{Real, reduce};
use std::f64::consts::LOG2_E;

/// Where one of the three gradients goes.
struct Gradient<'a, T> {
    out: Interleaved<'a, T>,
    at: Strides,
    beta: T,
}

impl<'a, T: Real> Gradient<'a, T> {
    fn new(size: &Attention, tokens: usize, target: (Target<'a, T>, Strides), name: &str) -> Self {
        let ((out, beta), at) = target;
        at.check(size, tokens, out.len(), name);
        at.check_apart(size, tokens, name);
        Self { out: Interleaved::new(out), at, beta }
    }

    /// Stores tokens `first..` of one entry and head, rows of `dim`.
    ///
    /// # Safety
    /// No other task may store the same tokens.
    #[allow(unsafe_code)]
    unsafe fn store(&self, b: usize, h: usize, first: usize, dim: usize, rows: &[T]) {
        for (i, row) in rows.chunks_exact(dim.max(1)).enumerate() {
            let at = self.at.at(b, h, first + i);
            // SAFETY: vectors do not overlap, and this one is the caller's alone.
            let out = unsafe { self.out.slice(at, dim) };
            out.iter_mut().zip(row).for_each(|(out, x)| put(out, self.beta, *x));
        }
    }
}

/// Gradients of [`attention_forward`](super::attention_forward) with respect to q, k and v, each if asked for.
///
/// `out` and `lse` are what the forward pass wrote; `dout` is laid out like `out`.
pub fn attention_backward<T: Real>(
    size: &Attention,
    scale: T,
    q: (&[T], Strides),
    k: (&[T], Strides),
    v: (&[T], Strides),
    out: (&[T], Strides),
    lse: &[T],
    dout: &[T],
    dq: Option<(Target<T>, Strides)>,
    dk: Option<(Target<T>, Strides)>,
    dv: Option<(Target<T>, Strides)>,
) {
    let dq = dq.map(|d| Gradient::new(size, size.queries, d, "dq"));
    let dk = dk.map(|d| Gradient::new(size, size.keys, d, "dk"));
    let dv = dv.map(|d| Gradient::new(size, size.keys, d, "dv"));
    Backward { size, scale, q, k, v, out, lse, dout }.run([dq, dk, dv]);
}

struct Backward<'a, T> {
    size: &'a Attention,
    scale: T,
    q: (&'a [T], Strides),
    k: (&'a [T], Strides),
    v: (&'a [T], Strides),
    out: (&'a [T], Strides),
    lse: &'a [T],
    dout: &'a [T],
}

impl<T: Real> Backward<'_, T> {
    fn run(&self, gradients: [Option<Gradient<T>>; 3]) {
        let Attention { batch, heads, queries, keys, .. } = *self.size;
        self.q.1.check(self.size, queries, self.q.0.len(), "q");
        self.k.1.check(self.size, keys, self.k.0.len(), "k");
        self.v.1.check(self.size, keys, self.v.0.len(), "v");
        self.out.1.check(self.size, queries, self.out.0.len().min(self.dout.len()), "the output");
        assert_eq!(
            Some(self.lse.len()),
            product([batch, heads, queries]),
            "attention: length of lse of {:?}",
            self.size
        );
        for_ranges(batch * heads, 1, |range| range.for_each(|plane| self.head(plane, &gradients)));
    }

    /// One entry and head: tiles of queries outside, of keys inside.
    fn head(&self, plane: usize, [dq, dk, dv]: &[Option<Gradient<T>>; 3]) {
        let Self { scale, q, k, v, out, lse, dout, .. } = *self;
        let Attention { heads, queries, keys, dim, .. } = *self.size;
        let (b, h, block) = (plane / heads, plane % heads, tile_rows(queries));
        T::with_scratch(2 * block * KEYS + block * (dim + 1) + 2 * keys * dim, |scratch| {
            let (weights, rest) = scratch.split_at_mut(block * KEYS);
            let (dscores, rest) = rest.split_at_mut(block * KEYS);
            let (q_sums, rest) = rest.split_at_mut(block * dim);
            let (k_sums, rest) = rest.split_at_mut(keys * dim);
            let (v_sums, along) = rest.split_at_mut(keys * dim);
            k_sums.fill(T::ZERO);
            v_sums.fill(T::ZERO);
            for first in (0..queries).step_by(block.max(1)) {
                let rows = block.min(queries - first);
                let (out_at, lse) = (out.1.at(b, h, first), &lse[plane * queries + first..][..rows]);
                for i in 0..rows {
                    let at = out_at + i * out.1.token;
                    along[i] = reduce::lanes([&out.0[at..at + dim], &dout[at..at + dim]], |[x, y]| x * y);
                }
                q_sums.fill(T::ZERO);
                let q = Mat::new(&q.0[q.1.at(b, h, first)..], q.1.token);
                let dout = Mat::new(&dout[out_at..], out.1.token);
                for from in (0..keys).step_by(KEYS) {
                    let n = KEYS.min(keys - from);
                    let k = Mat::new(&k.0[k.1.at(b, h, from)..], k.1.token);
                    let v = Mat::new(&v.0[v.1.at(b, h, from)..], v.1.token);
                    let (weights, dscores) = (&mut weights[..rows * n], &mut dscores[..rows * n]);
                    let powers = scale * T::from_f64(LOG2_E);
                    gemm_serial(rows, n, dim, powers, q, k.transposed(), T::ZERO, weights, n);
                    gemm_serial(rows, n, dim, T::ONE, dout, v.transposed(), T::ZERO, dscores, n);
                    lanes::run(Scores { n, weights, dscores, lse, along, scale });
                    let (weights, dscores) = (Mat::new(weights, n), Mat::new(dscores, n));
                    let keys = from * dim..(from + n) * dim;
                    if dv.is_some() {
                        let sums = &mut v_sums[keys.clone()];
                        gemm_serial(n, dim, rows, T::ONE, weights.transposed(), dout, T::ONE, sums, dim);
                    }
                    if dk.is_some() {
                        let sums = &mut k_sums[keys];
                        gemm_serial(n, dim, rows, T::ONE, dscores.transposed(), q, T::ONE, sums, dim);
                    }
                    if dq.is_some() {
                        gemm_serial(rows, dim, n, T::ONE, dscores, k, T::ONE, q_sums, dim);
                    }
                }
                if let Some(dq) = dq {
                    // SAFETY: this task alone has this entry and head.
                    #[allow(unsafe_code)]
                    unsafe {
                        dq.store(b, h, first, dim, &q_sums[..rows * dim]);
                    }
                }
            }
            for (gradient, sums) in [(dk, k_sums), (dv, v_sums)] {
                if let Some(gradient) = gradient {
                    // SAFETY: this task alone has this entry and head.
                    #[allow(unsafe_code)]
                    unsafe {
                        gradient.store(b, h, 0, dim, sums);
                    }
                }
            }
        });
    }
}

/// Turns scores and the gradients of weights, `n` keys for each query, into weights and the gradients of scores.
struct Scores<'a, T> {
    n: usize,
    weights: &'a mut [T],
    dscores: &'a mut [T],
    lse: &'a [T],
    along: &'a [T],
    scale: T,
}

impl<T: Real> LaneKernel<T> for Scores<'_, T> {
    type Output = ();

    #[inline(always)]
    fn run<V: Lanes<Scalar = T>>(self) {
        let Self { n, weights, dscores, lse, along, scale } = self;
        let rows = weights.chunks_exact_mut(n).zip(dscores.chunks_exact_mut(n));
        for (((weights, dscores), lse), along) in rows.zip(lse).zip(along) {
            let (lse, along, scale) = (V::splat(*lse), V::splat(*along), V::splat(scale));
            lanes::map(
                [],
                weights,
                #[inline(always)]
                |[], x: V| (x - lse).exp2(),
            );
            lanes::map(
                [weights],
                dscores,
                #[inline(always)]
                |[w], d: V| w * (d - along) * scale,
            );
        }
    }
}
