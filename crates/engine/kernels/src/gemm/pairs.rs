//! Products in pairs of bf16, by the instruction of AVX-512 BF16.

use super::{Mat, MatMut, Panels, Product, transpose};
use crate::parallel::for_chunks;
use crate::simd;
use half::bf16;
use std::ops::Range;

/// W^T in pairs of bf16: every number of a panel holds two rows of a column.
struct ColumnsOfPairs<'a> {
    data: &'a [bf16],
    depth: usize,
}

impl Panels<f32> for ColumnsOfPairs<'_> {
    fn pack(
        &self,
        _entry: usize,
        k: Range<usize>,
        cols: Range<usize>,
        padded: usize,
        panel: &mut [f32],
        spare: &mut [f32],
    ) {
        if k.is_empty() {
            return;
        }
        let (depth, width) = (k.len(), cols.len());
        let spare = &mut spare[..depth * width];
        simd::dispatch(
            #[inline(always)]
            || {
                for (to, column) in spare.chunks_exact_mut(depth).zip(cols) {
                    let column = &self.data[column * self.depth..][..self.depth];
                    let column = &column[2 * k.start..column.len().min(2 * k.end)];
                    pairs(column, |x| u32::from(x.to_bits()), to);
                }
            },
        );
        transpose(spare, 1, depth, depth, width, padded, panel);
    }
}

/// Packs two numbers of 16 bits into the bits of one `f32`. An odd last number is paired with zero.
#[inline(always)]
fn pairs<X>(from: &[X], bits: impl Fn(&X) -> u32, to: &mut [f32]) {
    let (whole, rest) = from.as_chunks::<2>();
    for (to, [low, high]) in to.iter_mut().zip(whole) {
        *to = f32::from_bits(bits(low) | bits(high) << 16);
    }
    if let ([last], Some(to)) = (rest, to.get_mut(whole.len())) {
        *to = f32::from_bits(bits(last));
    }
}

/// The bits of the nearest bf16; ties round to even.
#[inline(always)]
fn round_to_bf16(x: &f32) -> u32 {
    let bits = x.to_bits();
    let rounded = (bits.wrapping_add(0x7fff + (bits >> 16 & 1))) >> 16;
    if x.is_nan() { bits >> 16 | 0x40 } else { rounded }
}

/// [`gemm_half`](super::gemm_half) in pairs of bf16; the processor must have the instruction.
pub(super) fn gemm_pairs(a: Mat<f32>, w: &[bf16], beta: f32, c: MatMut<f32>, scratch: &mut [f32]) {
    let (m, k) = (a.rows, a.cols);
    let depth = k.div_ceil(2);
    let rounded = &mut scratch[..m * depth];
    if k > 0 {
        for_chunks(rounded, depth, |row, to| {
            simd::dispatch(
                #[inline(always)]
                || pairs(&a.data[row * a.row_stride..][..k], round_to_bf16, to),
            );
        });
    }
    let b = ColumnsOfPairs { data: w, depth: k };
    let a = Mat::new(&*rounded, m, depth);
    Product { alpha: 1.0, a: a.batch(0), b: &b, beta, pairs: true }.run(1, c.batch(0), true);
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::Stream;

    #[test]
    fn numbers_are_rounded_as_defined() {
        let stream = Stream::new(4, 0, "noise");
        let edges = [0.0, -0.0, 1.0, f32::MAX, f32::MIN_POSITIVE, f32::INFINITY, f32::NEG_INFINITY, f32::NAN, 1e-45];
        for x in (0..1000).map(|i| stream.normal(i)).chain(edges) {
            let (ours, theirs) = (round_to_bf16(&x), u32::from(bf16::from_f32(x).to_bits()));
            assert!(ours == theirs || x.is_nan() && bf16::from_bits(ours as u16).is_nan(), "{x}: {ours:x} {theirs:x}");
        }
    }
}
