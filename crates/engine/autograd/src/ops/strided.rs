//! Loops over a contiguous tensor and another one with arbitrary strides.

use crate::op::GRAIN;
use crate::{MAX_RANK, Shape};
use weaver_kernels::{Real, parallel};

/// Maps every position of a contiguous tensor, in order, to an offset in a strided one.
#[derive(Clone, Copy, Debug)]
pub(super) struct Strided {
    dims: [usize; MAX_RANK],
    strides: [usize; MAX_RANK],
    rank: usize,
}

/// The strides of a contiguous tensor.
pub(super) fn contiguous(shape: Shape) -> [usize; MAX_RANK] {
    let mut strides = [1; MAX_RANK];
    for axis in (1..shape.rank()).rev() {
        strides[axis - 1] = strides[axis] * shape[axis];
    }
    strides
}

impl Strided {
    /// Merges neighboring axes that are contiguous in both tensors.
    pub fn new(shape: Shape, strides: &[usize]) -> Self {
        let mut merged = Self { dims: [1; MAX_RANK], strides: [0; MAX_RANK], rank: 1 };
        for (&dim, &stride) in shape.dims().iter().zip(strides) {
            let last = merged.rank - 1;
            if merged.dims[last] == 1 {
                (merged.dims[last], merged.strides[last]) = (dim, stride);
            } else if dim != 1 && merged.strides[last] == stride * dim {
                merged.dims[last] *= dim;
                merged.strides[last] = stride;
            } else if dim != 1 {
                (merged.dims[last + 1], merged.strides[last + 1]) = (dim, stride);
                merged.rank += 1;
            }
        }
        merged
    }

    /// Length of a run along the last axis, and its stride.
    fn run(&self) -> (usize, usize) {
        (self.dims[self.rank - 1], self.strides[self.rank - 1])
    }

    /// Offset of the start of run `row`.
    fn offset(&self, mut row: usize) -> usize {
        let mut offset = 0;
        for axis in (0..self.rank - 1).rev() {
            offset += row % self.dims[axis] * self.strides[axis];
            row /= self.dims[axis];
        }
        offset
    }

    /// Copies the strided tensor to the contiguous one.
    pub fn gather<T: Real>(&self, x: &[T], out: &mut [T]) {
        let (length, stride) = self.run();
        if out.is_empty() {
            return;
        }
        let rows = GRAIN.div_ceil(length);
        parallel::for_chunks(out, rows * length, |chunk, out| {
            for (r, out) in out.chunks_exact_mut(length).enumerate() {
                let x = &x[self.offset(chunk * rows + r)..];
                match stride {
                    0 => out.fill(x[0]),
                    1 => out.copy_from_slice(&x[..length]),
                    _ => out.iter_mut().zip(x.iter().step_by(stride)).for_each(|(o, x)| *o = *x),
                }
            }
        });
    }

    /// Adds the contiguous tensor to the strided one, in the order of the contiguous one.
    pub fn scatter_add<T: Real>(&self, y: &[T], dx: &mut [T]) {
        let (length, stride) = self.run();
        if y.is_empty() {
            return;
        }
        for (row, y) in y.chunks_exact(length).enumerate() {
            let dx = &mut dx[self.offset(row)..];
            if stride == 0 {
                dx[0] += y.iter().copied().sum();
            } else {
                dx.iter_mut().step_by(stride).zip(y).for_each(|(d, y)| *d += *y);
            }
        }
    }
}
