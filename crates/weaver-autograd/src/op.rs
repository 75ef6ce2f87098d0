//! What an op is, and what it sees of the tape's memory.

use crate::{Pool, Shape, ShapeError, Shapes};
use std::fmt::Debug;
use std::ops::{Deref, DerefMut};
use weaver_kernels::{Real, gemm::Half, parallel, simd};

/// A differentiable operation: a value that owns its parameters and saved state.
///
/// The tape calls [`shapes`](Op::shapes), allocates the outputs, and calls [`forward`](Op::forward) once;
/// [`backward`](Op::backward) follows if a gradient reaches one of its outputs. Large saved state comes from
/// [`Pool::buffer`] or goes into auxiliary outputs, so that a repeated step allocates nothing.
///
/// If every output is empty, neither is called: there is nothing to compute, and the gradients are zero.
pub trait Op<T: Real>: Debug + Send + 'static {
    /// The op's name in messages and profiles.
    fn name(&self) -> &'static str;

    /// Checks the inputs and gives the outputs' shapes. The only place where shapes are checked.
    fn shapes(&self, ins: &[Shape]) -> Result<Shapes, ShapeError>;

    /// Computes every output in full; on entry they hold unspecified numbers.
    fn forward(&mut self, ins: &[View<'_, T>], outs: &mut [ViewMut<'_, T>], pool: &Pool);

    /// Adds `sum over outputs of dout * d out / d in` to every gradient that is asked for.
    ///
    /// `douts[i]` has the shape of output i (zeros where no gradient arrived) and is empty for auxiliary
    /// outputs. `dins[i]` is `None` where nobody asks; where it is `Some`, it must be written.
    fn backward(
        &self,
        ins: &[View<'_, T>],
        outs: &[View<'_, T>],
        douts: &[View<'_, T>],
        dins: &mut [Option<Grad<'_, T>>],
        pool: &Pool,
    );

    /// How many of the last outputs are auxiliary: readable values (statistics, counts, saved state) that carry no
    /// gradient. A gradient that reaches one panics with the op's name.
    fn auxiliary_outputs(&self) -> usize {
        0
    }

    /// Whether input `index` may be stored in half precision ([`View::half`]). Any other op that is given such an input
    /// panics with its name.
    fn reads_half(&self, index: usize) -> bool {
        let _ = index;
        false
    }

    /// Whether input `index` has a gradient. A gradient that would be needed for one that has none panics
    /// with the op's name; `Var::detach` says that it is not needed.
    fn differentiable(&self, index: usize) -> bool {
        let _ = index;
        true
    }
}

/// A tensor to read: contiguous, row-major.
#[derive(Clone, Copy, Debug)]
pub struct View<'a, T> {
    data: &'a [T],
    half: Option<Half<'a>>,
    shape: Shape,
}

impl<'a, T> View<'a, T> {
    /// Wraps a slice whose length is that of the shape.
    pub fn new(data: &'a [T], shape: impl Into<Shape>) -> Self {
        let shape = shape.into();
        assert_eq!(data.len(), shape.len(), "a view of shape {shape} needs as many elements");
        Self { data, half: None, shape }
    }

    /// Wraps a slice in half precision.
    pub(crate) fn of_half(half: Half<'a>, shape: Shape) -> Self {
        assert_eq!(half.len(), shape.len(), "a view of shape {shape} needs as many elements");
        Self { data: &[], half: Some(half), shape }
    }

    /// A view of nothing, for outputs without gradient.
    pub(crate) fn nothing() -> Self {
        Self { data: &[], half: None, shape: Shape::from([0]) }
    }

    /// The elements of a tensor in half precision, which has no others.
    pub fn half(&self) -> Option<Half<'a>> {
        self.half
    }

    /// Its dimensions.
    pub fn shape(&self) -> Shape {
        self.shape
    }

    /// The elements, for as long as the tensor lives.
    pub fn data(&self) -> &'a [T] {
        self.data
    }
}

impl<T> Deref for View<'_, T> {
    type Target = [T];
    fn deref(&self) -> &[T] {
        self.data
    }
}

/// A tensor to write: contiguous, row-major.
#[derive(Debug)]
pub struct ViewMut<'a, T> {
    data: &'a mut [T],
    shape: Shape,
}

impl<'a, T> ViewMut<'a, T> {
    /// Wraps a slice whose length is that of the shape.
    pub fn new(data: &'a mut [T], shape: impl Into<Shape>) -> Self {
        let shape = shape.into();
        assert_eq!(data.len(), shape.len(), "a view of shape {shape} needs as many elements");
        Self { data, shape }
    }

    /// Its dimensions.
    pub fn shape(&self) -> Shape {
        self.shape
    }
}

impl<T> Deref for ViewMut<'_, T> {
    type Target = [T];
    fn deref(&self) -> &[T] {
        self.data
    }
}

impl<T> DerefMut for ViewMut<'_, T> {
    fn deref_mut(&mut self) -> &mut [T] {
        self.data
    }
}

/// A gradient to add to.
///
/// It knows whether this is its first write: the memory then holds nothing yet and is overwritten, so there is
/// neither a zero fill nor an extra addition. The tape checks that each gradient asked for was written.
#[derive(Debug)]
pub struct Grad<'a, T> {
    data: &'a mut [T],
    first: bool,
    written: bool,
}

/// Elements per parallel chunk of an elementwise loop.
pub(crate) const GRAIN: usize = 8192;

impl<'a, T: Real> Grad<'a, T> {
    /// A gradient over `data`, which holds a sum already unless this is its `first` write.
    pub fn new(data: &'a mut [T], first: bool) -> Self {
        Self { data, first, written: false }
    }

    /// Number of elements.
    pub fn len(&self) -> usize {
        self.data.len()
    }

    /// Whether there are no elements.
    pub fn is_empty(&self) -> bool {
        self.data.is_empty()
    }

    /// Whether something has been written (or there is nothing to write).
    pub fn is_written(&self) -> bool {
        self.written || self.data.is_empty()
    }

    /// The sum so far, if there is one.
    pub(crate) fn so_far(&self) -> Option<&[T]> {
        (!self.first).then_some(&*self.data)
    }

    /// The memory and the factor for what is in it: 0 at the first write (do not read it), then 1. For GEMM.
    pub fn target(&mut self) -> (&mut [T], T) {
        let beta = if self.first { T::ZERO } else { T::ONE };
        self.first = false;
        self.written = true;
        (self.data, beta)
    }

    /// The memory ready for `+=`: cleared at the first write.
    pub fn accumulator(&mut self) -> &mut [T] {
        if self.first {
            self.data.fill(T::ZERO);
        }
        self.first = false;
        self.written = true;
        self.data
    }

    /// Adds `f(i)` to element i, for all i, in parallel.
    pub fn add_each(&mut self, f: impl Fn(usize) -> T + Sync) {
        let (data, beta) = self.target();
        let first = beta == T::ZERO;
        parallel::for_chunks(data, GRAIN, |chunk, out| {
            let start = chunk * GRAIN;
            simd::dispatch(
                #[inline(always)]
                || {
                    if first {
                        out.iter_mut().enumerate().for_each(|(i, g)| *g = f(start + i));
                    } else {
                        out.iter_mut().enumerate().for_each(|(i, g)| *g += f(start + i));
                    }
                },
            );
        });
    }

    /// Adds a slice of the same length.
    pub fn add(&mut self, values: &[T]) {
        assert_eq!(values.len(), self.len(), "a gradient is added to one of the same length");
        self.add_each(|i| values[i]);
    }

    /// Adds nothing, explicitly: the gradient is known to be zero.
    pub fn add_zero(&mut self) {
        self.accumulator();
    }
}
