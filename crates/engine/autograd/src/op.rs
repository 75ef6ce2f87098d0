//! The trait of differentiable operations, and the views of tensors that an operation gets.

use crate::{Pool, Shape, ShapeError, Shapes};
use std::fmt::Debug;
use std::ops::{Deref, DerefMut};
use weaver_kernels::{Real, gemm::Half, parallel, simd};

/// A differentiable operation: a value that owns its settings and its saved state.
///
/// The tape calls [`shapes`](Op::shapes), allocates the outputs, and calls [`forward`](Op::forward) once. If a gradient
/// reaches one of the outputs, it later calls [`backward`](Op::backward). Large saved state should come from
/// [`Pool::buffer`] or be an auxiliary output, so that a repeated step allocates nothing.
///
/// If every output is empty, neither `forward` nor `backward` is called, and the gradients are zero.
pub trait Op<T: Real>: Debug + Send + 'static {
    /// The name of the op in messages and profiles.
    fn name(&self) -> &'static str;

    /// Checks the shapes of the inputs and returns the outputs' shapes. This is the only place where shapes are
    /// checked.
    fn shapes(&self, ins: &[Shape]) -> Result<Shapes, ShapeError>;

    /// Computes every output in full. On entry, the outputs hold unspecified numbers.
    fn forward(&mut self, ins: &[View<'_, T>], outs: &mut [ViewMut<'_, T>], pool: &Pool);

    /// Adds the gradient with respect to every input that needs one: the sum over outputs of `dout * d out / d in`.
    fn backward(&self, at: Backward<'_, '_, T>);

    /// The number of auxiliary outputs, which come last: values to read, such as statistics, counts or saved state,
    /// that have no gradient. The tape panics with the name of the op if a gradient reaches one.
    fn auxiliary_outputs(&self) -> usize {
        0
    }

    /// True if input `index` may be stored in half precision, to be read by [`View::half`]. The tape panics with the
    /// name of the op if such an input is given to an op that does not accept it.
    fn reads_half(&self, index: usize) -> bool {
        let _ = index;
        false
    }

    /// True if the op is differentiable with respect to input `index`. If it is not, and the input depends on a leaf,
    /// the tape panics with the name of the op; [`Var::detach`](crate::Var::detach) states that no gradient is needed.
    fn differentiable(&self, index: usize) -> bool {
        let _ = index;
        true
    }
}

/// Everything that [`Op::backward`] gets.
#[derive(Debug)]
pub struct Backward<'a, 'g, T: Real> {
    /// The inputs.
    pub ins: &'a [View<'a, T>],
    /// The outputs.
    pub outs: &'a [View<'a, T>],
    /// Gradients with respect to the outputs, in their shapes: zeros if none arrived, empty for auxiliary outputs.
    pub douts: &'a [View<'a, T>],
    /// Gradients with respect to the inputs: `None` if an input needs none; otherwise it must be written.
    pub dins: &'a mut [Option<Grad<'g, T>>],
    /// Memory for large buffers.
    pub pool: &'a Pool,
}

/// A contiguous row-major tensor to read.
#[derive(Clone, Copy, Debug)]
pub struct View<'a, T> {
    data: &'a [T],
    half: Option<Half<'a>>,
    shape: Shape,
}

impl<'a, T> View<'a, T> {
    /// Wraps a slice.
    ///
    /// # Panics
    ///
    /// If the length does not fit the shape.
    pub fn new(data: &'a [T], shape: impl Into<Shape>) -> Self {
        let shape = shape.into();
        assert_eq!(data.len(), shape.len(), "a view of shape {shape} needs as many elements");
        Self { data, half: None, shape }
    }

    /// Wraps a tensor in half precision.
    pub(crate) fn of_half(half: Half<'a>, shape: Shape) -> Self {
        assert_eq!(half.len(), shape.len(), "a view of shape {shape} needs as many elements");
        Self { data: &[], half: Some(half), shape }
    }

    /// An empty view, for the gradient of auxiliary outputs.
    pub(crate) fn nothing() -> Self {
        Self { data: &[], half: None, shape: Shape::from([0]) }
    }

    /// The elements of a tensor that is stored in half precision, whose `f32` or `f64` elements are empty; `None` for
    /// others.
    pub fn half(&self) -> Option<Half<'a>> {
        self.half
    }

    /// The shape of the tensor.
    pub fn shape(&self) -> Shape {
        self.shape
    }

    /// The elements, borrowed for as long as the tensor lives.
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

/// A contiguous row-major tensor to write.
#[derive(Debug)]
pub struct ViewMut<'a, T> {
    data: &'a mut [T],
    shape: Shape,
}

impl<'a, T> ViewMut<'a, T> {
    /// Wraps a slice.
    ///
    /// # Panics
    ///
    /// If the length does not fit the shape.
    pub fn new(data: &'a mut [T], shape: impl Into<Shape>) -> Self {
        let shape = shape.into();
        assert_eq!(data.len(), shape.len(), "a view of shape {shape} needs as many elements");
        Self { data, shape }
    }

    /// The shape of the tensor.
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

/// A gradient that an op adds to.
///
/// The first write overwrites the memory, which then needs no clearing; later ones add. The tape checks that every
/// gradient that is needed was written.
#[derive(Debug)]
pub struct Grad<'a, T> {
    data: &'a mut [T],
    first: bool,
    written: bool,
}

/// Elements per parallel chunk of an elementwise loop.
pub(crate) const GRAIN: usize = 8192;

impl<'a, T: Real> Grad<'a, T> {
    /// Wraps the memory of a gradient, which already holds a sum unless this is the `first` write.
    pub fn new(data: &'a mut [T], first: bool) -> Self {
        Self { data, first, written: false }
    }

    /// Number of elements.
    pub fn len(&self) -> usize {
        self.data.len()
    }

    /// True if there are no elements.
    pub fn is_empty(&self) -> bool {
        self.data.is_empty()
    }

    /// True if the gradient has been written, or has no elements.
    pub fn is_written(&self) -> bool {
        self.written || self.data.is_empty()
    }

    /// The sum so far; `None` before the first write.
    pub(crate) fn so_far(&self) -> Option<&[T]> {
        (!self.first).then_some(&*self.data)
    }

    /// The memory and the factor of its present contents, 0 at the first write and 1 later, as kernels take them
    /// ([`weaver_kernels::Target`]). With a factor of 0 the memory must not be read.
    pub fn target(&mut self) -> (&mut [T], T) {
        let beta = if self.first { T::ZERO } else { T::ONE };
        self.first = false;
        self.written = true;
        (self.data, beta)
    }

    /// The memory, ready to add to: the first write clears it.
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

    /// Adds a slice.
    ///
    /// # Panics
    ///
    /// If the lengths differ.
    pub fn add(&mut self, values: &[T]) {
        assert_eq!(values.len(), self.len(), "a gradient is added to one of the same length");
        self.add_each(|i| values[i]);
    }

    /// Adds zero: states that the gradient is known to vanish.
    pub fn add_zero(&mut self) {
        self.accumulator();
    }
}
