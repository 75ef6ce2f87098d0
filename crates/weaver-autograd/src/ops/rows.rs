//! Copies and sums of whole rows by index.

use crate::op::GRAIN;
use weaver_kernels::{Real, parallel};

/// out row i = x row `indices[i]` + beta * out row i; beta is 0 or 1, and with 0 `out` is not read.
pub(super) fn gather<T: Real>(x: &[T], indices: &[u32], out: &mut [T], beta: T) {
    let width = out.len() / indices.len().max(1);
    if width == 0 {
        return;
    }
    let rows = GRAIN.div_ceil(width);
    parallel::for_chunks(out, rows * width, |chunk, out| {
        for (out, &index) in out.chunks_exact_mut(width).zip(&indices[chunk * rows..]) {
            let x = &x[index as usize * width..][..width];
            if beta == T::ZERO {
                out.copy_from_slice(x);
            } else {
                out.iter_mut().zip(x).for_each(|(o, x)| *o += *x);
            }
        }
    });
}

/// out row `indices[i]` += x row i, in order of i.
pub(super) fn scatter_add<T: Real>(x: &[T], indices: &[u32], out: &mut [T]) {
    let width = x.len() / indices.len().max(1);
    if width == 0 {
        return;
    }
    for (x, &index) in x.chunks_exact(width).zip(indices) {
        out[index as usize * width..][..width].iter_mut().zip(x).for_each(|(o, x)| *o += *x);
    }
}
