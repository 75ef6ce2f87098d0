//! Permutation of the axes of a tensor.

use crate::Real;
use crate::gemm::transpose;
use crate::parallel::for_chunks;
use crate::target::{Target, put};

/// Elements of one task.
const GRAIN: usize = 1 << 14;
/// Rows that are transposed together in registers.
const TILE: usize = 16;

/// Permutes the axes of a tensor: axis i of y is axis `axes[i]` of x.
///
/// `shape` is the shape of `x`. The gradient of a permutation is the permutation by the [`inverse`] order.
///
/// # Panics
///
/// If `axes` is not a permutation of 0..N, or a length does not fit the shape.
///
/// ```
/// use weaver_kernels::permute::permute;
/// let mut y = [0.0; 4];
/// permute([2, 2], [1, 0], &[1.0, 2.0, 3.0, 4.0], (&mut y, 0.0));
/// assert_eq!(y, [1.0, 3.0, 2.0, 4.0]);
/// ```
#[inline(never)]
pub fn permute<T: Real, const N: usize>(shape: [usize; N], axes: [usize; N], x: &[T], y: Target<T>) {
    let (y, beta) = y;
    let len: usize = shape.iter().product();
    assert_eq!((x.len(), y.len()), (len, len), "permute: lengths for {shape:?}");
    inverse(axes);
    if len == 0 {
        return;
    }
    let Walk { dims, strides, rank } = Walk::new(shape, axes);
    // y consists of blocks of c rows of d elements, which are sc and sd elements apart in x.
    let axis = |index: Option<usize>, none| index.map_or((1, none), |axis| (dims[axis], strides[axis]));
    let ((c, sc), (d, sd)) = (axis(rank.checked_sub(2), 0), axis(rank.checked_sub(1), 1));
    let block = |mut index: usize| {
        let mut offset = 0;
        for axis in (0..rank.saturating_sub(2)).rev() {
            offset += index % dims[axis] * strides[axis];
            index /= dims[axis];
        }
        offset
    };
    let transposes = sc == 1 && c >= TILE && beta == T::ZERO;
    let grain = GRAIN.div_ceil(d).next_multiple_of(if transposes { TILE } else { 1 });
    for_chunks(y, grain * d, |chunk, mut y| {
        let mut row = chunk * grain;
        while !y.is_empty() {
            let rows = (c - row % c).min(y.len() / d);
            let (part, rest) = y.split_at_mut(rows * d);
            let x = &x[block(row / c) + row % c * sc..];
            if transposes {
                transpose(x, 1, sd, rows, d, d, part);
            } else {
                for (j, y) in part.chunks_exact_mut(d).enumerate() {
                    let x = &x[j * sc..];
                    match sd {
                        1 if beta == T::ZERO => y.copy_from_slice(&x[..d]),
                        1 => y.iter_mut().zip(x).for_each(|(y, x)| put(y, beta, *x)),
                        _ => y.iter_mut().zip(x.iter().step_by(sd)).for_each(|(y, x)| put(y, beta, *x)),
                    }
                }
            }
            (row, y) = (row + rows, rest);
        }
    });
}

/// The axes of y, each with its stride in x. Axes that are adjacent in x as well are merged, and axes of length 1
/// dropped.
struct Walk<const N: usize> {
    dims: [usize; N],
    strides: [usize; N],
    rank: usize,
}

impl<const N: usize> Walk<N> {
    fn new(shape: [usize; N], axes: [usize; N]) -> Self {
        let mut contiguous = [1; N];
        for axis in (1..N).rev() {
            contiguous[axis - 1] = contiguous[axis] * shape[axis];
        }
        let mut walk = Self { dims: [1; N], strides: [0; N], rank: 0 };
        for (dim, stride) in axes.map(|axis| (shape[axis], contiguous[axis])) {
            let Self { dims, strides, rank } = &mut walk;
            if dim == 1 {
                continue;
            }
            if *rank > 0 && strides[*rank - 1] == dim * stride {
                dims[*rank - 1] *= dim;
                strides[*rank - 1] = stride;
            } else {
                (dims[*rank], strides[*rank]) = (dim, stride);
                *rank += 1;
            }
        }
        walk
    }
}

/// The inverse of a permutation of axes.
///
/// # Panics
///
/// If `axes` is not a permutation of 0..N.
///
/// ```
/// assert_eq!(weaver_kernels::permute::inverse([1, 2, 0]), [2, 0, 1]);
/// ```
pub fn inverse<const N: usize>(axes: [usize; N]) -> [usize; N] {
    let mut back = [N; N];
    for (i, axis) in axes.into_iter().enumerate() {
        assert!(axis < N && back[axis] == N, "permute: {axes:?} is not a permutation");
        back[axis] = i;
    }
    back
}
