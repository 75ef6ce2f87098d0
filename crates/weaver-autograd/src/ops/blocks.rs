//! Copies a column block of one matrix into a column block of another.

use crate::op::GRAIN;
use weaver_kernels::{Real, parallel};

/// A block of columns of a row-major matrix: where it starts, and how long the matrix's rows are.
#[derive(Clone, Copy, Debug)]
pub(super) struct Columns {
    pub pitch: usize,
    pub start: usize,
}

/// dst = src + beta * dst for `width` columns of every row of `dst`; beta is 0 or 1, and with 0 `dst` is not read.
pub(super) fn copy_columns<T: Real>(src: &[T], from: Columns, dst: &mut [T], to: Columns, width: usize, beta: T) {
    if to.pitch == 0 || width == 0 {
        return;
    }
    let rows = GRAIN.div_ceil(to.pitch);
    parallel::for_chunks(dst, rows * to.pitch, |chunk, dst| {
        for (r, dst) in dst.chunks_exact_mut(to.pitch).enumerate() {
            let src = &src[(chunk * rows + r) * from.pitch + from.start..][..width];
            let dst = &mut dst[to.start..][..width];
            if beta == T::ZERO {
                dst.copy_from_slice(src);
            } else {
                dst.iter_mut().zip(src).for_each(|(d, s)| *d += *s);
            }
        }
    });
}

/// A shape around one axis: the product of the dimensions before it, its own, and the product of those after it.
pub(super) fn around(shape: crate::Shape, axis: usize) -> [usize; 3] {
    let dims = shape.dims();
    [dims[..axis].iter().product(), dims[axis], dims[axis + 1..].iter().product()]
}
