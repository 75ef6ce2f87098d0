//! Gradients of attention. Scores are recomputed tile by tile.

use super::{AttentionInputs, AttentionShape, KEYS, Strides, tile_rows};
use crate::gemm::{Mat, MatMut, gemm_serial};
use crate::lanes::{self, LaneKernel, Lanes};
use crate::parallel::{Interleaved, for_ranges};
use crate::target::{Target, put};
use crate::{Real, reduce};
use std::f64::consts::LOG2_E;

/// The output of one of the three gradients.
struct Gradient<'a, T> {
    out: Interleaved<'a, T>,
    at: Strides,
    beta: T,
}

impl<'a, T: Real> Gradient<'a, T> {
    fn new(shape: &AttentionShape, tokens: usize, target: (Target<'a, T>, Strides), name: &str) -> Self {
        let ((out, beta), at) = target;
        at.check(shape, tokens, out.len(), name);
        at.check_apart(shape, tokens, name);
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
            // SAFETY: vectors do not overlap, and no other task stores this one.
            let out = unsafe { self.out.slice(at, dim) };
            out.iter_mut().zip(row).for_each(|(out, x)| put(out, self.beta, *x));
        }
    }
}

/// The output of [`attention_forward`](super::attention_forward).
#[derive(Clone, Copy, Debug)]
pub struct AttentionOutput<'a, T> {
    /// The output vectors.
    pub out: (&'a [T], Strides),
    /// The binary logarithms of the sums of exponentials, `[batch, heads, queries]`.
    pub lse: &'a [T],
}

/// Gradients of [`attention_forward`](super::attention_forward) with respect to q, k and v, each on request.
///
/// `dout`, the gradient with respect to the output, is laid out like `output.out`.
///
/// # Panics
///
/// If a slice is too short, or vectors of a gradient overlap.
#[inline(never)]
pub fn attention_backward<T: Real>(
    inputs: &AttentionInputs<T>,
    output: &AttentionOutput<T>,
    dout: &[T],
    [dq, dk, dv]: [Option<(Target<T>, Strides)>; 3],
) {
    let shape = &inputs.shape;
    let AttentionShape { batch, heads, queries, keys, .. } = *shape;
    inputs.check(output.lse);
    output.out.1.check(shape, queries, output.out.0.len().min(dout.len()), "the output");
    let dq = dq.map(|d| Gradient::new(shape, queries, d, "dq"));
    let dk = dk.map(|d| Gradient::new(shape, keys, d, "dk"));
    let dv = dv.map(|d| Gradient::new(shape, keys, d, "dv"));
    let (backward, gradients) = (Backward { inputs, output, dout }, [dq, dk, dv]);
    for_ranges(batch * heads, 1, |range| range.for_each(|plane| backward.head(plane, &gradients)));
}

struct Backward<'a, T> {
    inputs: &'a AttentionInputs<'a, T>,
    output: &'a AttentionOutput<'a, T>,
    dout: &'a [T],
}

impl<T: Real> Backward<'_, T> {
    /// One batch entry and head: an outer loop over tiles of queries, an inner loop over tiles of keys.
    fn head(&self, plane: usize, [dq, dk, dv]: &[Option<Gradient<T>>; 3]) {
        let AttentionInputs { shape, scale, q, k, v } = *self.inputs;
        let AttentionOutput { out, lse } = *self.output;
        let AttentionShape { heads, queries, keys, dim, .. } = shape;
        let dout = self.dout;
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
                #[expect(clippy::needless_range_loop, reason = "the row's number is also where it lies in the output")]
                for i in 0..rows {
                    let at = out_at + i * out.1.token;
                    along[i] = reduce::lanes([&out.0[at..at + dim], &dout[at..at + dim]], |[x, y]| x * y);
                }
                q_sums.fill(T::ZERO);
                let q = Mat::new(&q.0[q.1.at(b, h, first)..], rows, dim).with_row_stride(q.1.token);
                let dout = Mat::new(&dout[out_at..], rows, dim).with_row_stride(out.1.token);
                for from in (0..keys).step_by(KEYS) {
                    let n = KEYS.min(keys - from);
                    let k = Mat::new(&k.0[k.1.at(b, h, from)..], n, dim).with_row_stride(k.1.token);
                    let v = Mat::new(&v.0[v.1.at(b, h, from)..], n, dim).with_row_stride(v.1.token);
                    let (weights, dscores) = (&mut weights[..rows * n], &mut dscores[..rows * n]);
                    let powers = scale * T::from_f64(LOG2_E);
                    gemm_serial(powers, q, k.transposed(), T::ZERO, MatMut::new(weights, rows, n));
                    gemm_serial(T::ONE, dout, v.transposed(), T::ZERO, MatMut::new(dscores, rows, n));
                    lanes::run(Scores { n, weights, dscores, lse, along, scale });
                    let (weights, dscores) = (Mat::new(weights, rows, n), Mat::new(dscores, rows, n));
                    let keys = from * dim..(from + n) * dim;
                    if dv.is_some() {
                        let sums = MatMut::new(&mut v_sums[keys.clone()], n, dim);
                        gemm_serial(T::ONE, weights.transposed(), dout, T::ONE, sums);
                    }
                    if dk.is_some() {
                        let sums = MatMut::new(&mut k_sums[keys], n, dim);
                        gemm_serial(T::ONE, dscores.transposed(), q, T::ONE, sums);
                    }
                    if dq.is_some() {
                        gemm_serial(T::ONE, dscores, k, T::ONE, MatMut::new(&mut *q_sums, rows, dim));
                    }
                }
                if let Some(dq) = dq {
                    // SAFETY: no other task has this entry and head.
                    #[allow(unsafe_code)]
                    unsafe {
                        dq.store(b, h, first, dim, &q_sums[..rows * dim]);
                    }
                }
            }
            for (gradient, sums) in [(dk, k_sums), (dv, v_sums)] {
                if let Some(gradient) = gradient {
                    // SAFETY: no other task has this entry and head.
                    #[allow(unsafe_code)]
                    unsafe {
                        gradient.store(b, h, 0, dim, sums);
                    }
                }
            }
        });
    }
}

/// Turns scores into weights, and gradients with respect to weights into gradients with respect to scores, for `n` keys
/// per query.
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
