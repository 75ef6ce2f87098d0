//! Rows of matrices moved about: gather, scatter-add, blocks with gaps.

use crate::Real;
use crate::parallel::for_chunks;
use crate::target::{Target, put};

/// Elements of one task.
const GRAIN: usize = 1 << 14;
/// Ranges of output rows among which a scatter is shared out; each range reads all indices.
const RANGES: usize = 16;

/// `y[i] = beta y[i] + x[index[i]]`, rows of length `cols`: `x` `[rows, cols]`, `y` `[index.len(), cols]`. Panics if an index is
/// too large.
///
/// ```
/// use weaver_kernels::rows::gather_rows;
/// let mut y = [0.0; 3];
/// gather_rows(1, &[5.0, 7.0], &[1, 1, 0], (&mut y, 0.0));
/// assert_eq!(y, [7.0, 7.0, 5.0]);
/// ```
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

/// `y[index[i]] += x[i]` on top of `beta y`, rows of length `cols`: `x` `[index.len(), cols]`, `y`
/// `[rows, cols]`. Indices may repeat; their rows are added in the order of i. Panics if an index is
/// too large.
///
/// ```
/// use weaver_kernels::rows::scatter_add_rows;
/// let mut y = [0.0; 2];
/// scatter_add_rows(1, &[1.0, 2.0, 4.0], &[1, 0, 1], (&mut y, 0.0));
/// assert_eq!(y, [2.0, 5.0]);
/// ```
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

/// y = beta y + x for `rows` blocks of `cols` elements that begin `x_stride` and `y_stride` apart.
///
/// To join along an axis, or to cut, see a tensor as `[outer, axis inner]`: each part is `outer` rows of
/// `part inner` columns, and its slice of the whole begins where its first row does. Panics if blocks of y overlap.
///
/// ```
/// use weaver_kernels::rows::copy_blocks;
/// let mut y = [0.0; 4]; // The last two columns of a 2 x 3 matrix.
/// copy_blocks(2, 2, &[1.0, 2.0, 3.0, 4.0, 5.0, 6.0][1..], 3, (&mut y, 0.0), 2);
/// assert_eq!(y, [2.0, 3.0, 5.0, 6.0]);
/// ```
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
