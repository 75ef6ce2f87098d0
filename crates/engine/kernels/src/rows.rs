//! Operations on rows of matrices: gather, scatter-add, strided copies.

use crate::Real;
use crate::parallel::for_chunks;
use crate::target::{Target, put};

/// Elements of one task.
const GRAIN: usize = 1 << 14;
/// Number of ranges of output rows into which a scatter is divided; each range reads all indices.
const RANGES: usize = 16;

/// Gathers rows of length `cols`: `y[i] = beta y[i] + x[index[i]]`.
///
/// `x` is `[rows, cols]`, `y` `[index.len(), cols]`.
///
/// # Panics
///
/// If an index is not below the number of rows, or a length does not fit.
///
/// ```
/// use weaver_kernels::rows::gather_rows;
/// let mut y = [0.0; 3];
/// gather_rows(1, &[5.0, 7.0], &[1, 1, 0], (&mut y, 0.0));
/// assert_eq!(y, [7.0, 7.0, 5.0]);
/// ```
#[inline(never)]
pub fn gather_rows<T: Real>(cols: usize, x: &[T], index: &[u32], y: Target<T>) {
    let (y, beta) = y;
    assert_eq!(y.len(), index.len() * cols, "gather_rows: output length");
    if cols == 0 {
        return;
    }
    let grain = GRAIN.div_ceil(cols);
    for_chunks(y, grain * cols, |chunk, y| {
        for (y, from) in y.chunks_exact_mut(cols).zip(&index[chunk * grain..]) {
            y.iter_mut().zip(&x[*from as usize * cols..][..cols]).for_each(|(y, x)| put(y, beta, *x));
        }
    });
}

/// Adds rows of length `cols` to the rows that an index names: y becomes `beta y`, then `y[index[i]] += x[i]`.
///
/// `x` is `[index.len(), cols]`, `y` `[rows, cols]`. Indices may repeat; their rows are added in the order of i.
///
/// # Panics
///
/// If an index is not below the number of rows, or a length does not fit.
///
/// ```
/// use weaver_kernels::rows::scatter_add_rows;
/// let mut y = [0.0; 2];
/// scatter_add_rows(1, &[1.0, 2.0, 4.0], &[1, 0, 1], (&mut y, 0.0));
/// assert_eq!(y, [2.0, 5.0]);
/// ```
#[inline(never)]
pub fn scatter_add_rows<T: Real>(cols: usize, x: &[T], index: &[u32], y: Target<T>) {
    let (y, beta) = y;
    assert_eq!(x.len(), index.len() * cols, "scatter_add_rows: input length");
    if cols == 0 {
        return;
    }
    assert_eq!(y.len() % cols, 0, "scatter_add_rows: output length");
    let rows = y.len() / cols;
    assert!(index.iter().all(|i| (*i as usize) < rows), "scatter_add_rows: an index is not below {rows}");
    if beta == T::ZERO {
        y.fill(T::ZERO);
    }
    let grain = GRAIN.div_ceil(cols).max(rows.div_ceil(RANGES));
    for_chunks(y, grain * cols, |chunk, y| {
        let (first, count) = (chunk * grain, y.len() / cols);
        for (i, to) in index.iter().enumerate() {
            let to = (*to as usize).wrapping_sub(first);
            if to < count {
                let x = &x[i * cols..][..cols];
                y[to * cols..][..cols].iter_mut().zip(x).for_each(|(y, x)| *y += *x);
            }
        }
    });
}

/// Copies or adds `rows` blocks of `cols` elements between strided layouts: y = beta y + x.
///
/// Blocks begin `x_stride` elements apart in `x` and `y_stride` apart in `y`. Concatenating and slicing along an axis
/// need this: seen as `[outer, axis inner]`, a part of a tensor is `outer` blocks of `part inner` elements.
///
/// # Panics
///
/// If blocks of `y` overlap, or a slice is too short.
///
/// ```
/// use weaver_kernels::rows::copy_blocks;
/// let mut y = [0.0; 4]; // The last two columns of a 2 x 3 matrix.
/// copy_blocks(2, 2, &[1.0, 2.0, 3.0, 4.0, 5.0, 6.0][1..], 3, (&mut y, 0.0), 2);
/// assert_eq!(y, [2.0, 3.0, 5.0, 6.0]);
/// ```
#[inline(never)]
pub fn copy_blocks<T: Real>(rows: usize, cols: usize, x: &[T], x_stride: usize, y: Target<T>, y_stride: usize) {
    let (y, beta) = y;
    if rows == 0 || cols == 0 {
        return;
    }
    assert!(y_stride >= cols, "copy_blocks: blocks overlap");
    let y = &mut y[..(rows - 1) * y_stride + cols];
    let grain = GRAIN.div_ceil(cols);
    for_chunks(y, grain * y_stride, |chunk, y| {
        for (i, y) in y.chunks_mut(y_stride).enumerate() {
            let x = &x[(chunk * grain + i) * x_stride..][..cols];
            y[..cols].iter_mut().zip(x).for_each(|(y, x)| put(y, beta, *x));
        }
    });
}
