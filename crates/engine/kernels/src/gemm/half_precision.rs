//! Products with a matrix that is stored in half precision.

use super::{Mat, MatMut, Panels, Product, transpose};
use crate::extent::product;
use crate::{Real, simd};
use half::{bf16, f16};
use std::ops::Range;

/// A matrix `[n, k]` stored in half precision, and how it is multiplied.
#[derive(Clone, Copy, Debug)]
pub enum Half<'a> {
    /// Converted to full precision while it is packed: the result has the bits of the same product in full precision.
    Bf16(&'a [bf16]),
    /// Multiplied by the processor's instruction for pairs of bf16 (AVX-512 BF16), which does twice the operations at a
    /// time. The other factor must be `f32` and is first rounded to bf16, whose 8 bits mean a relative error of up to
    /// 2^-9 in each product; sums are `f32`. On processors without the instruction, and in `f64`, this is the same as
    /// `Bf16`.
    Bf16Pairs(&'a [bf16]),
    /// Converted to full precision while it is packed, as `Bf16` is.
    F16(&'a [f16]),
}

impl Half<'_> {
    /// Number of elements.
    pub fn len(&self) -> usize {
        match self {
            Self::Bf16(data) | Self::Bf16Pairs(data) => data.len(),
            Self::F16(data) => data.len(),
        }
    }

    /// True if there are no elements.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Converts all elements to full precision, exactly.
    ///
    /// # Panics
    ///
    /// If the lengths differ.
    #[inline(never)]
    pub fn widen<T: Real>(&self, wide: &mut [T]) {
        self.widen_part(0..self.len(), wide);
    }

    fn widen_part<T: Real>(&self, part: Range<usize>, wide: &mut [T]) {
        assert_eq!(part.len(), wide.len(), "widen: as many numbers out as in");
        simd::dispatch(
            #[inline(always)]
            || match self {
                Self::Bf16(data) | Self::Bf16Pairs(data) => {
                    for (wide, narrow) in wide.iter_mut().zip(&data[part]) {
                        // A bf16 is the upper half of an f32.
                        *wide = T::from_f32(f32::from_bits(u32::from(narrow.to_bits()) << 16));
                    }
                }
                Self::F16(data) => {
                    for (wide, narrow) in wide.iter_mut().zip(&data[part]) {
                        *wide = T::from_f32(widen_f16(narrow.to_bits()));
                    }
                }
            },
        );
    }
}

/// Converts an f16 to `f32` without a branch: multiplying by 2^112 adjusts the exponent and normalizes subnormal
/// numbers.
#[inline(always)]
fn widen_f16(bits: u16) -> f32 {
    let (sign, rest) = (u32::from(bits & 0x8000) << 16, u32::from(bits & 0x7fff) << 13);
    let wide = (f32::from_bits(rest) * f32::from_bits(0x7780_0000)).to_bits();
    // Infinity and NaN have all bits of the exponent set.
    let special = if rest >= 0x0f80_0000 { 0x7f80_0000 | rest } else { wide };
    f32::from_bits(sign | special)
}

/// W^T, packed column by column.
struct Columns<'a> {
    data: Half<'a>,
    depth: usize,
}

impl<T: Real> Panels<T> for Columns<'_> {
    fn pack(
        &self,
        _entry: usize,
        k: Range<usize>,
        cols: Range<usize>,
        padded: usize,
        panel: &mut [T],
        spare: &mut [T],
    ) {
        if k.is_empty() {
            return;
        }
        let (depth, width) = (k.len(), cols.len());
        let wide = &mut spare[..depth * width];
        for (wide, column) in wide.chunks_exact_mut(depth).zip(cols) {
            let start = column * self.depth;
            self.data.widen_part(start + k.start..start + k.end, wide);
        }
        transpose(wide, 1, depth, depth, width, padded, panel);
    }
}

/// Length of the scratch space of [`gemm_half`], for A m x k.
pub fn gemm_half_scratch_len(m: usize, k: usize, w: Half) -> usize {
    if matches!(w, Half::Bf16Pairs(_)) { m * k.div_ceil(2) } else { 0 }
}

/// C = A W^T + beta C, where W is stored in half precision.
///
/// `a` is m x k with contiguous rows, `w` `[n, k]` and contiguous, `c` m x n; with `beta` 0, C is not read. `scratch`
/// has [`gemm_half_scratch_len`] elements with any content. Unless W is multiplied in pairs, the bits are those that
/// [`gemm`](super::gemm) gives for W in full precision.
///
/// # Panics
///
/// If the shapes do not fit each other, or a slice is too short.
///
/// ```
/// use half::bf16;
/// use weaver_kernels::gemm::{Half, Mat, MatMut, gemm_half};
/// let w = [1.0, 2.0].map(bf16::from_f32); // 1 x 2
/// let mut c = [f32::NAN];
/// gemm_half(Mat::new(&[3.0, 4.0], 1, 2), Half::Bf16(&w), 0.0, MatMut::new(&mut c, 1, 1), &mut []);
/// assert_eq!(c, [11.0]);
/// ```
#[inline(never)]
pub fn gemm_half<T: Real>(a: Mat<T>, w: Half, beta: T, c: MatMut<T>, scratch: &mut [T]) {
    let (n, k) = (c.cols, a.cols);
    let fits = product([n, k]).is_some_and(|len| len <= w.len());
    assert!(fits, "gemm_half: W is {n} x {k} but its slice has {} elements", w.len());
    assert!(a.col_stride == 1 || k <= 1, "gemm_half: rows of A are not contiguous");
    let c = match w {
        Half::Bf16Pairs(w) => match T::gemm_pairs(a, w, beta, c, scratch) {
            Ok(()) => return,
            Err(c) => c,
        },
        _ => c,
    };
    let b = Columns { data: w, depth: k };
    Product { alpha: T::ONE, a: a.batch(0), b: &b, beta, pairs: false }.run(1, c.batch(0), true);
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::gemm::gemm;
    use crate::gemm::tile::Tile;
    use crate::random::Stream;

    fn noise(len: usize, seed: u64) -> Vec<f32> {
        let stream = Stream::new(seed, 0, "noise");
        (0..len as u64).map(|i| stream.normal(i)).collect()
    }

    const SIZES: [[usize; 3]; 7] =
        [[1, 1, 1], [3, 17, 5], [50, 40, 300], [7, 0, 4], [4, 6, 0], [200, 70, 64], [30, 200, 1101]];

    /// The bits equal the product with the converted matrix, and C is not read when beta is 0.
    #[test]
    fn equal_to_the_widened_product() {
        for [m, n, k] in SIZES {
            let a = noise(m * k, 1);
            let numbers = noise(n * k, 2);
            let brief: Vec<bf16> = numbers.iter().map(|x| bf16::from_f32(*x)).collect();
            let half: Vec<f16> = numbers.iter().map(|x| f16::from_f32(*x)).collect();
            for w in [Half::Bf16(&brief), Half::F16(&half)] {
                let mut wide = vec![0.0; w.len()];
                w.widen(&mut wide);
                for beta in [0.0, 1.0] {
                    let start = if beta == 0.0 { vec![f32::NAN; m * n] } else { noise(m * n, 3) };
                    let (mut c, mut expected) = (start.clone(), start);
                    let (a, wide) = (Mat::new(&a, m, k), Mat::new(&wide, n, k));
                    gemm_half(a, w, beta, MatMut::new(&mut c, m, n), &mut []);
                    gemm(1.0, a, wide.transposed(), beta, MatMut::new(&mut expected, m, n));
                    assert_eq!(c, expected, "{m}x{n}x{k}");
                }
            }
        }
    }

    /// Products of pairs equal the products of the rounded numbers up to the rounding of `f32` sums.
    #[test]
    fn pairs_are_products_of_rounded_numbers() {
        let paired = f32::gemm_pairs(Mat::new(&[], 0, 0), &[], 0.0, MatMut::new(&mut [], 0, 0), &mut []).is_ok();
        if !paired {
            println!("skipped: this processor has no products of bf16");
        }
        let round = |x: &f32| bf16::from_f32(*x).to_f32();
        for [m, n, k] in SIZES {
            let (a, w) = (noise(m * k, 1), noise(n * k, 2));
            let brief: Vec<bf16> = w.iter().map(|x| bf16::from_f32(*x)).collect();
            // Without the instruction, A is not rounded.
            let rounded: Vec<f32> = a.iter().map(|x| if paired { round(x) } else { *x }).collect();
            for beta in [0.0, 1.0] {
                let start = if beta == 0.0 { vec![f32::NAN; m * n] } else { noise(m * n, 3) };
                let mut c = start.clone();
                let w = Half::Bf16Pairs(&brief);
                let mut scratch = vec![f32::NAN; gemm_half_scratch_len(m, k, w)];
                gemm_half(Mat::new(&a, m, k), w, beta, MatMut::new(&mut c, m, n), &mut scratch);
                for (at, c) in c.iter().enumerate() {
                    let (i, j) = (at / n, at % n);
                    let products = || (0..k).map(|p| f64::from(rounded[i * k + p]) * brief[j * k + p].to_f64());
                    let before = if beta == 0.0 { 0.0 } else { f64::from(start[at]) };
                    let (exact, size) = (before + products().sum::<f64>(), products().map(f64::abs).sum::<f64>());
                    let error = (f64::from(*c) - exact).abs();
                    assert!(error <= 1e-7 * (1.0 + size) * (1.0 + k as f64).sqrt(), "{m}x{n}x{k} at {at}: {c} {exact}");
                }
            }
        }
    }

    #[test]
    fn every_half_is_widened_as_defined() {
        let halves: Vec<f16> = (0..=u16::MAX).map(f16::from_bits).collect();
        let mut wide = vec![0.0_f32; halves.len()];
        Half::F16(&halves).widen(&mut wide);
        for (wide, half) in wide.iter().zip(&halves) {
            assert!(wide.to_bits() == half.to_f32().to_bits() || wide.is_nan() && half.is_nan(), "{half:?}: {wide}");
        }
    }
}
