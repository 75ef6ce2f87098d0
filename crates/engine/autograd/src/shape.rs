//! Shapes of tensors, and the error of shapes that do not fit an op.

use std::fmt;
use std::ops::{Deref, Index};

/// The largest number of dimensions of a tensor.
pub const MAX_RANK: usize = 6;
/// The largest number of outputs of an op.
pub const MAX_OUTPUTS: usize = 12;

/// The dimensions of a contiguous row-major tensor, at most [`MAX_RANK`] of them. A scalar has rank 0.
///
/// A shape is `Copy` and needs no heap memory.
///
/// ```
/// use weaver_autograd::Shape;
/// let s = Shape::from([2, 3, 4]);
/// assert_eq!((s.len(), s.last(), s.rows()), (24, 4, 6));
/// ```
#[derive(Clone, Copy, PartialEq, Eq, Default)]
pub struct Shape {
    dims: [usize; MAX_RANK],
    rank: u8,
}

impl Shape {
    /// The shape of a single number.
    pub const SCALAR: Self = Self { dims: [0; MAX_RANK], rank: 0 };

    /// Creates a shape from its dimensions.
    ///
    /// # Panics
    ///
    /// If there are more than [`MAX_RANK`].
    pub fn new(dims: &[usize]) -> Self {
        assert!(dims.len() <= MAX_RANK, "a tensor has at most {MAX_RANK} dimensions, found {dims:?}");
        let mut shape = Self { rank: dims.len() as u8, ..Self::SCALAR };
        shape.dims[..dims.len()].copy_from_slice(dims);
        shape
    }

    /// The dimensions.
    pub fn dims(&self) -> &[usize] {
        &self.dims[..self.rank as usize]
    }

    /// Number of elements; 1 for a scalar.
    pub fn len(&self) -> usize {
        self.dims().iter().product()
    }

    /// True if there are no elements.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Number of dimensions.
    pub fn rank(&self) -> usize {
        self.rank as usize
    }

    /// The last dimension; 1 for a scalar.
    pub fn last(&self) -> usize {
        self.dims().last().copied().unwrap_or(1)
    }

    /// The product of all dimensions except the last: the number of rows of the tensor viewed as a matrix.
    pub fn rows(&self) -> usize {
        self.dims()[..self.rank().saturating_sub(1)].iter().product()
    }

    /// A copy of this shape with another last dimension.
    pub fn with_last(mut self, last: usize) -> Self {
        assert!(self.rank > 0, "a scalar has no last dimension");
        self.dims[self.rank as usize - 1] = last;
        self
    }

    /// A copy of this shape with another length of one axis.
    pub fn with_axis(mut self, axis: usize, len: usize) -> Self {
        assert!(axis < self.rank(), "{self} has no axis {axis}");
        self.dims[axis] = len;
        self
    }

    /// The tensor viewed as three dimensions around an axis: the product of the dimensions before it, its own length,
    /// and the product of the dimensions after it.
    pub fn around(&self, axis: usize) -> [usize; 3] {
        let dims = self.dims();
        [dims[..axis].iter().product(), dims[axis], dims[axis + 1..].iter().product()]
    }

    /// A copy of this shape without one of its axes.
    pub fn without_axis(mut self, axis: usize) -> Self {
        assert!(axis < self.rank(), "{self} has no axis {axis}");
        self.dims.copy_within(axis + 1.., axis);
        self.dims[MAX_RANK - 1] = 0;
        self.rank -= 1;
        self
    }
}

impl Index<usize> for Shape {
    type Output = usize;
    fn index(&self, axis: usize) -> &usize {
        &self.dims()[axis]
    }
}

impl<const N: usize> From<[usize; N]> for Shape {
    fn from(dims: [usize; N]) -> Self {
        Self::new(&dims)
    }
}

impl From<&[usize]> for Shape {
    fn from(dims: &[usize]) -> Self {
        Self::new(dims)
    }
}

impl fmt::Debug for Shape {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{:?}", self.dims())
    }
}

impl fmt::Display for Shape {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{:?}", self.dims())
    }
}

/// The shapes of an op's outputs, in order.
#[derive(Clone, Copy, Debug, Default)]
pub struct Shapes {
    shapes: [Shape; MAX_OUTPUTS],
    count: usize,
}

impl Shapes {
    /// A single output.
    pub fn one(shape: impl Into<Shape>) -> Self {
        Self::default().and(shape)
    }

    /// Adds one more output.
    pub fn and(mut self, shape: impl Into<Shape>) -> Self {
        assert!(self.count < MAX_OUTPUTS, "an op has at most {MAX_OUTPUTS} outputs");
        self.shapes[self.count] = shape.into();
        self.count += 1;
        self
    }
}

impl Deref for Shapes {
    type Target = [Shape];
    fn deref(&self) -> &[Shape] {
        &self.shapes[..self.count]
    }
}

/// The shapes of the inputs do not fit an op.
///
/// The message names the op, the model path at which it was applied, the shapes it expected, and those it found.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{}{op}: expected {expected}, found {found}", if path.is_empty() { String::new() } else { format!("{path}: ") })]
pub struct ShapeError {
    /// The op's name; filled in by the tape.
    pub op: &'static str,
    /// The model path, such as `encoder.block.3.attn`; filled in by the tape.
    pub path: String,
    /// The shapes that the op expects.
    pub expected: String,
    /// The shapes of the inputs; filled in by the tape if empty.
    pub found: String,
}

impl ShapeError {
    /// Creates an error that states the expectation; the tape adds the op, the path and the shapes found.
    pub fn expected(what: impl Into<String>) -> Self {
        Self { op: "", path: String::new(), expected: what.into(), found: String::new() }
    }
}

/// Returns [`ShapeError::expected`] from the calling function unless a condition on shapes holds.
///
/// For example `ensure_shape!(x.rank() == 2, "x [N, D]");`, with a message in the manner of `format!`.
#[macro_export]
macro_rules! ensure_shape {
    ($condition:expr, $($message:tt)+) => {
        if !$condition {
            return Err($crate::ShapeError::expected(format!($($message)+)));
        }
    };
}
