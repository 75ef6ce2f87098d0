//! Matrices as a product takes them: slices with a shape and strides.

use crate::Real;
use crate::extent::extent;

/// A matrix to read: element (i, j) is `data[i * row_stride + j * col_stride]`.
///
/// ```
/// use weaver_kernels::gemm::Mat;
/// let a = Mat::new(&[1.0, 2.0, 3.0, 4.0, 5.0, 6.0], 2, 3).transposed();
/// assert_eq!((a.rows, a.cols, a.data[2 * a.row_stride + a.col_stride]), (3, 2, 6.0));
/// ```
#[derive(Clone, Copy, Debug)]
pub struct Mat<'a, T> {
    /// The elements, beginning with (0, 0).
    pub data: &'a [T],
    /// Number of rows.
    pub rows: usize,
    /// Number of columns.
    pub cols: usize,
    /// Distance between neighboring rows, in elements.
    pub row_stride: usize,
    /// Distance between neighboring columns, in elements.
    pub col_stride: usize,
}

impl<'a, T: Real> Mat<'a, T> {
    /// A contiguous row-major matrix.
    #[inline]
    pub fn new(data: &'a [T], rows: usize, cols: usize) -> Self {
        Self { data, rows, cols, row_stride: cols, col_stride: 1 }
    }

    /// A matrix of the same shape whose rows begin `row_stride` elements apart, such as a part of a wider matrix.
    #[inline]
    pub fn with_row_stride(self, row_stride: usize) -> Self {
        Self { row_stride, ..self }
    }

    /// The transpose. Only the strides change; no element moves.
    #[inline]
    pub fn transposed(self) -> Self {
        Self {
            data: self.data,
            rows: self.cols,
            cols: self.rows,
            row_stride: self.col_stride,
            col_stride: self.row_stride,
        }
    }

    /// The first of several matrices of this shape that begin `stride` elements apart in `data`. A stride of 0 uses
    /// this matrix for every entry of the batch.
    #[inline]
    pub fn batch(self, stride: usize) -> Batch<Self> {
        Batch { first: self, stride }
    }
}

/// A row-major matrix to write: element (i, j) is `data[i * row_stride + j]`.
#[derive(Debug)]
pub struct MatMut<'a, T> {
    /// The elements, beginning with (0, 0).
    pub data: &'a mut [T],
    /// Number of rows.
    pub rows: usize,
    /// Number of columns.
    pub cols: usize,
    /// Distance between neighboring rows, in elements; at least `cols`.
    pub row_stride: usize,
}

impl<'a, T: Real> MatMut<'a, T> {
    /// A contiguous matrix.
    #[inline]
    pub fn new(data: &'a mut [T], rows: usize, cols: usize) -> Self {
        Self { data, rows, cols, row_stride: cols }
    }

    /// A matrix of the same shape whose rows begin `row_stride` elements apart, such as a part of a wider matrix.
    #[inline]
    pub fn with_row_stride(self, row_stride: usize) -> Self {
        Self { row_stride, ..self }
    }

    /// The first of several matrices of this shape that begin `stride` elements apart in `data`.
    #[inline]
    pub fn batch(self, stride: usize) -> Batch<Self> {
        Batch { first: self, stride }
    }
}

/// Matrices of one shape that lie a fixed distance apart; made by [`Mat::batch`] and [`MatMut::batch`].
#[derive(Clone, Copy, Debug)]
pub struct Batch<M> {
    /// The first matrix, whose slice reaches to the end of the last one.
    pub first: M,
    /// Distance between neighboring matrices, in elements.
    pub stride: usize,
}

impl<T: Real> Batch<Mat<'_, T>> {
    /// The transposes. Only the strides change; no element moves.
    #[inline]
    pub fn transposed(self) -> Self {
        Self { first: self.first.transposed(), stride: self.stride }
    }

    /// Panics unless `batch` matrices lie inside the slice.
    pub(super) fn check(&self, batch: usize, name: &str) {
        let Mat { data, rows, cols, row_stride, col_stride } = self.first;
        let reach = extent([(batch, self.stride), (rows, row_stride), (cols, col_stride)]);
        let fits = reach.is_some_and(|reach| reach <= data.len());
        assert!(fits, "gemm: {name} is {batch} x {rows} x {cols} but its slice has {} elements", data.len());
    }
}

impl<T: Real> Batch<MatMut<'_, T>> {
    /// Panics unless `batch` matrices lie inside the slice, apart from each other.
    pub(super) fn check(&self, batch: usize) {
        let MatMut { ref data, rows, cols, row_stride } = self.first;
        assert!(row_stride >= cols, "gemm: rows of C overlap");
        let one = [(rows, row_stride), (cols, 1)];
        let apart = batch == 1 || extent(one).is_some_and(|len| len <= self.stride);
        assert!(apart, "gemm: matrices of C overlap");
        let fits = extent([(batch, self.stride), one[0], one[1]]).is_some_and(|len| len <= data.len());
        assert!(fits, "gemm: C is too short");
    }
}
