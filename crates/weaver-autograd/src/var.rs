//! A handle to a value on a tape.

use crate::tape::ValueId;
use crate::{Shape, Tape};
use std::cell::Ref;
use std::fmt;
use weaver_kernels::Real;

/// A tensor on a [`Tape`]: a `Copy` handle that borrows the tape.
#[derive(Clone, Copy)]
pub struct Var<'t, T: Real = f32> {
    tape: &'t Tape<T>,
    id: ValueId,
    shape: Shape,
    tracked: bool,
}

impl<T: Real> fmt::Debug for Var<'_, T> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "Var {} ", self.shape)?;
        f.debug_list().entries(self.value().iter().take(8)).finish()
    }
}

impl<'t, T: Real> Var<'t, T> {
    pub(crate) fn new(tape: &'t Tape<T>, id: ValueId, shape: Shape, tracked: bool) -> Self {
        Self { tape, id, shape, tracked }
    }

    pub(crate) fn id(&self) -> ValueId {
        self.id
    }

    /// The tape that this value lives on.
    pub fn tape(&self) -> &'t Tape<T> {
        self.tape
    }

    /// Its dimensions.
    pub fn shape(&self) -> Shape {
        self.shape
    }

    /// Whether a gradient can flow back through this handle.
    pub fn is_tracked(&self) -> bool {
        self.tracked
    }

    /// Its numbers, row-major. The borrow must end before the next op is applied.
    pub fn value(&self) -> Ref<'t, [T]> {
        self.tape.value(self.id)
    }

    /// A copy of its numbers.
    pub fn to_vec(&self) -> Vec<T> {
        self.value().to_vec()
    }

    /// The one number of a one-element tensor.
    #[track_caller]
    pub fn item(&self) -> T {
        self.tape.ensure_shapes(self.shape.len() == 1, "item", "a single element", &[self.shape]);
        self.value()[0]
    }

    /// The same numbers under another shape; free.
    #[track_caller]
    pub fn reshape(self, shape: impl Into<Shape>) -> Self {
        let shape = shape.into();
        let fits = shape.len() == self.shape.len();
        self.tape.ensure_shapes(fits, "reshape", format_args!("a tensor of the size of {shape}"), &[self.shape]);
        Self { shape, ..self }
    }

    /// The same value, through which no gradient flows; free.
    pub fn detach(self) -> Self {
        Self { tracked: false, ..self }
    }

    /// Keeps this value's gradient after the backward pass, as leaves do.
    pub fn retain_grad(self) -> Self {
        self.tape.retain(self.id);
        self
    }

    /// The gradient of the last backward pass; `None` if none reached this value.
    pub fn grad(&self) -> Option<Vec<T>> {
        self.tape.grad(self.id).map(|g| g.to_vec())
    }

    /// Fills the gradients of all leaves that this scalar depends on. Called again, it adds to them.
    #[track_caller]
    pub fn backward(&self) {
        self.tape.ensure_shapes(
            self.shape.len() == 1,
            "backward",
            "a single element (or backward_with)",
            &[self.shape],
        );
        self.backward_with(&[T::ONE]);
    }

    /// The same from a tensor, given the gradient of the loss with respect to it.
    #[track_caller]
    pub fn backward_with(&self, cotangent: &[T]) {
        let fits = self.shape.len() == cotangent.len();
        let expected = format_args!("a cotangent of the size of {}", self.shape);
        self.tape.ensure_shapes(fits, "backward_with", expected, &[[cotangent.len()].into()]);
        assert!(self.tracked, "backward() of a value that depends on no leaf");
        self.tape.backward_from(self.id, cotangent);
    }
}
