//! Products with a matrix that is stored in half precision and widened while it is packed.

use super::{Mat, Panels, Product, transpose};
use crate::{Real, simd};
use half::bf16;
use std::ops::Range;

/// A matrix of columns that lie one after the other: op(B) = W^T for W `[n, k]`.
struct Columns<'a> {
    data: &'a [bf16],
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
            widen(&self.data[column * self.depth + k.start..][..depth], wide);
        }
        transpose(wide, 1, depth, depth, width, padded, panel);
    }
}

/// The same numbers in full precision; nothing is lost. Panics if the lengths differ.
pub fn widen<T: Real>(narrow: &[bf16], wide: &mut [T]) {
    assert_eq!(narrow.len(), wide.len(), "widen: as many numbers out as in");
    simd::dispatch(
        #[inline(always)]
        || {
            for (wide, narrow) in wide.iter_mut().zip(narrow) {
                // What a bf16 is: the upper half of an f32.
                *wide = T::from_f32(f32::from_bits(u32::from(narrow.to_bits()) << 16));
            }
        },
    );
}

/// C = A W^T + beta C, where W is stored in half precision.
///
/// `a` holds `[m, k]`, `w` `[n, k]`, `c` `[m, n]`, all contiguous; with `beta` 0, C is not read. The same bits as
/// [`gemm`](super::gemm) gives for W in full precision. Panics if a slice is too short.
pub fn gemm_bf16<T: Real>(m: usize, n: usize, k: usize, a: &[T], w: &[bf16], beta: T, c: &mut [T]) {
    assert!(w.len() >= n * k, "gemm_bf16: W is {n} x {k} but its slice has {} elements", w.len());
    let b = Columns { data: w, depth: k };
    let a = Mat::new(a, k);
    Product { batch: 1, a_step: 0, c_step: m * n, m, n, k, alpha: T::ONE, a, b: &b, beta }.run(c, n, true);
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::gemm::gemm;
    use crate::random::Stream;

    /// The same bits as with the widened matrix, and nothing read of C when beta is 0.
    #[test]
    fn equal_to_the_widened_product() {
        let noise = |len: usize, seed| -> Vec<f32> {
            let stream = Stream::new(seed, 0, "noise");
            (0..len as u64).map(|i| stream.normal(i)).collect()
        };
        for [m, n, k] in [[1, 1, 1], [3, 17, 5], [50, 40, 300], [7, 0, 4], [4, 6, 0], [200, 70, 64]] {
            let a = noise(m * k, 1);
            let w: Vec<bf16> = noise(n * k, 2).iter().map(|x| bf16::from_f32(*x)).collect();
            let mut wide = vec![0.0; w.len()];
            widen(&w, &mut wide);
            assert!(wide.iter().zip(&w).all(|(a, b)| *a == b.to_f32()));
            for beta in [0.0, 1.0] {
                let start = if beta == 0.0 { vec![f32::NAN; m * n] } else { noise(m * n, 3) };
                let (mut c, mut expected) = (start.clone(), start);
                gemm_bf16(m, n, k, &a, &w, beta, &mut c);
                gemm(false, true, m, n, k, 1.0, &a, &wide, beta, &mut expected);
                assert_eq!(c, expected, "{m}x{n}x{k}");
            }
        }
    }
}
