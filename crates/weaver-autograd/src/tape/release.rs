//! Gives memory back while nothing is recorded: a forward pass that nobody walks back over needs little at a time.

use super::{Storage, Tape};
use crate::{Buffer, Shape, Var};
use weaver_kernels::Real;

/// A moment on a tape, to say from where on values are given back.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Mark(usize);

impl<T: Real> Tape<T> {
    /// This moment.
    pub fn mark(&self) -> Mark {
        Mark(self.record.borrow().values.len())
    }

    /// While nothing is recorded ([`without_gradient`](Tape::without_gradient)), gives back the memory of every value made
    /// since `mark` but those in `keep`; reading one of them later panics. While recording it does nothing: the backward
    /// pass needs them.
    ///
    /// ```
    /// use weaver_autograd::Tape;
    /// let tape = Tape::<f32>::new();
    /// let x = tape.constant(&[1.0, 2.0], [2]);
    /// tape.without_gradient(|| {
    ///     let mark = tape.mark();
    ///     let y = (x + 1.0) * x;
    ///     tape.keep_only(mark, &[y]);
    ///     assert_eq!(y.to_vec(), [2.0, 6.0]);
    /// });
    /// ```
    pub fn keep_only(&self, mark: Mark, keep: &[Var<'_, T>]) {
        if self.recording.get() {
            return;
        }
        let values = &mut self.record.borrow_mut().values[mark.0..];
        for (value, id) in values.iter_mut().zip(mark.0..) {
            if keep.iter().all(|var| var.id() as usize != id) {
                value.storage = Storage::Released;
            }
        }
    }

    /// Runs `f`; while nothing is recorded, its result is all that stays of it in memory.
    pub fn result_of<'t>(&'t self, f: impl FnOnce() -> Var<'t, T>) -> Var<'t, T> {
        let mark = self.mark();
        let result = f();
        self.keep_only(mark, &[result]);
        result
    }

    /// Whether applied ops are recorded.
    pub fn is_recording(&self) -> bool {
        self.recording.get()
    }

    /// A constant in a buffer that was filled before, without a copy.
    pub fn constant_of(&self, buffer: Buffer<T>, shape: impl Into<Shape>) -> Var<'_, T> {
        let shape = self.checked(buffer.len(), shape);
        self.push_source(Storage::Pooled(buffer), shape, false)
    }
}
