//! Axes of four-dimensional arrays in another order.

use crate::Real;
use crate::gemm::transpose;
use crate::parallel::for_chunks;
use crate::target::{Target, put};

/// Elements of one task.
const GRAIN: usize = 1 << 14;

/// y = beta y + x with its axes in the order `axes`: y's axis i is x's axis `axes[i]`.
///
/// `x` has shape `shape`; arrays of fewer axes have leading ones of length 1. The gradient is the
/// permutation by [`inverse`].
///
/// ```
/// use weaver_kernels::permute::permute;
/// let mut y = [0.0; 4];
/// permute([1, 1, 2, 2], [0, 1, 3, 2], &[1.0, 2.0, 3.0, 4.0], (&mut y, 0.0));
/// assert_eq!(y, [1.0, 3.0, 2.0, 4.0]);
/// ```
pub fn permute<T: Real>(shape: [usize; 4], axes: [usize; 4], x: &[T], y: Target<T>) {
    let (y, beta) = y;
    let len: usize = shape.iter().product();
    assert_eq!((x.len(), y.len()), (len, len), "permute: lengths for {shape:?}");
    inverse(axes);
    if len == 0 {
        return;
    }
    let strides = [shape[1] * shape[2] * shape[3], shape[2] * shape[3], shape[3], 1];
    let [_, b, c, d] = axes.map(|axis| shape[axis]);
    let [sa, sb, sc, sd] = axes.map(|axis| strides[axis]);
    let grain = GRAIN.div_ceil(c * d);
    for_chunks(y, grain * c * d, |chunk, y| {
        for (i, y) in y.chunks_exact_mut(c * d).enumerate() {
            let i = chunk * grain + i;
            let x = &x[i / b * sa + i % b * sb..];
            if sc == 1 && beta == T::ZERO {
                transpose(x, 1, sd, c, d, d, y);
                continue;
            }
            for (j, y) in y.chunks_exact_mut(d).enumerate() {
                let x = &x[j * sc..];
                if sd == 1 {
                    y.iter_mut().zip(x).for_each(|(y, x)| put(y, beta, *x));
                } else {
                    y.iter_mut().zip(x.iter().step_by(sd)).for_each(|(y, x)| put(y, beta, *x));
                }
            }
        }
    });
}

/// The order of axes that undoes `axes`. Panics if `axes` is not a permutation of 0..4.
pub fn inverse(axes: [usize; 4]) -> [usize; 4] {
    let mut back = [4; 4];
    for (i, axis) in axes.into_iter().enumerate() {
        back[axis] = i;
    }
    assert!(back.iter().all(|i| *i < 4), "permute: {axes:?} is not a permutation");
    back
}
