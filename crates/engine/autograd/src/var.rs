//! Handles to tensors on a tape.

use crate::tape::ValueId;
use crate::{Shape, Tape};
use std::cell::Ref;
use std::fmt;
use weaver_kernels::Real;

/// A tensor on a [`Tape`]: a handle that is `Copy` and borrows the tape.
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

    /// The tape that holds this tensor.
    pub fn tape(&self) -> &'t Tape<T> {
        self.tape
    }

    /// The shape of the tensor.
    pub fn shape(&self) -> Shape {
        self.shape
    }

    /// True if the tensor depends on a leaf, so that gradients flow back through this handle.
    pub fn is_tracked(&self) -> bool {
        self.tracked
    }

    /// Borrows the elements, row-major. The borrow must end before the next op is applied.
    pub fn value(&self) -> Ref<'t, [T]> {
        self.tape.value(self.id)
    }

    /// Copies the elements.
    pub fn to_vec(&self) -> Vec<T> {
        self.value().to_vec()
    }

    /// The value of a tensor with a single element.
    ///
    /// # Panics
    ///
    /// If the tensor has another number of elements.
    #[track_caller]
    pub fn item(&self) -> T {
        self.tape.ensure_shapes(self.shape.len() == 1, "item", "a single element", &[self.shape]);
        self.value()[0]
    }

    /// The tensor with another shape of as many elements. Nothing is copied. Differentiable.
    ///
    /// # Panics
    ///
    /// If the number of elements differs.
    #[track_caller]
    pub fn reshape(self, shape: impl Into<Shape>) -> Self {
        let shape = shape.into();
        let fits = shape.len() == self.shape.len();
        self.tape.ensure_shapes(fits, "reshape", format_args!("a tensor of the size of {shape}"), &[self.shape]);
        Self { shape, ..self }
    }

    /// The tensor as a constant, through which no gradient flows. Nothing is copied.
    pub fn detach(self) -> Self {
        Self { tracked: false, ..self }
    }

    /// Keeps the gradient with respect to this tensor after the backward pass, as leaves do.
    pub fn retain_grad(self) -> Self {
        self.tape.retain(self.id);
        self
    }

    /// The gradient with respect to this tensor after a backward pass; `None` if no gradient reached it.
    pub fn grad(&self) -> Option<Vec<T>> {
        self.tape.grad(self.id).map(|g| g.to_vec())
    }

    /// Computes the gradients of this scalar with respect to all leaves and parameters it depends on. Another call adds
    /// to them.
    ///
    /// # Panics
    ///
    /// If the tensor has more than one element or depends on no leaf.
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

    /// Starts the backward pass at this tensor, given `cotangent`, the gradient of the loss with respect to it. Another
    /// call adds to the gradients of leaves and parameters.
    ///
    /// # Panics
    ///
    /// If the lengths differ or the tensor depends on no leaf.
    #[track_caller]
    pub fn backward_with(&self, cotangent: &[T]) {
        let fits = self.shape.len() == cotangent.len();
        let expected = format_args!("a cotangent of the size of {}", self.shape);
        self.tape.ensure_shapes(fits, "backward_with", expected, &[[cotangent.len()].into()]);
        assert!(self.tracked, "backward() of a value that depends on no leaf");
        self.tape.backward_from(self.id, cotangent);
    }
}
