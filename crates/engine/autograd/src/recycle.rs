//! Reuse of boxed ops between steps: recording an op of a type that was seen before allocates nothing.

use crate::Op;
use std::any::{Any, TypeId};
use weaver_kernels::Real;

/// A box for one op of a fixed type, which can be emptied and refilled.
pub(crate) trait Slot<T: Real>: Any + Send {
    fn op(&self) -> &dyn Op<T>;
    fn empty(&mut self);
    fn as_any(&mut self) -> &mut dyn Any;
}

struct Typed<O>(Option<O>);

impl<T: Real, O: Op<T>> Slot<T> for Typed<O> {
    fn op(&self) -> &dyn Op<T> {
        self.0.as_ref().expect("a recorded op is there until the tape is reset")
    }
    fn empty(&mut self) {
        self.0 = None;
    }
    fn as_any(&mut self) -> &mut dyn Any {
        self
    }
}

/// Empty boxes for one type of op.
type Shelf<T> = (TypeId, Vec<Box<dyn Slot<T>>>);

/// Empty boxes by the type of op they hold.
pub(crate) struct OpBoxes<T: Real> {
    empty: Vec<Shelf<T>>,
}

impl<T: Real> Default for OpBoxes<T> {
    fn default() -> Self {
        Self { empty: Vec::new() }
    }
}

impl<T: Real> OpBoxes<T> {
    /// Boxes an op, reusing an empty box of its type if there is one.
    #[inline(never)]
    pub(crate) fn store<O: Op<T>>(&mut self, op: O) -> Box<dyn Slot<T>> {
        let id = TypeId::of::<Typed<O>>();
        match self.empty.iter_mut().find(|(t, _)| *t == id).and_then(|(_, boxes)| boxes.pop()) {
            Some(mut used) => {
                *used.as_any().downcast_mut::<Typed<O>>().expect("boxes are kept by type") = Typed(Some(op));
                used
            }
            None => Box::new(Typed(Some(op))),
        }
    }

    /// Takes back a box and drops the op in it, so that the op's buffers return to their pool.
    pub(crate) fn put(&mut self, mut used: Box<dyn Slot<T>>) {
        used.empty();
        let id = Any::type_id(used.as_any());
        match self.empty.iter_mut().find(|(t, _)| *t == id) {
            Some((_, boxes)) => boxes.push(used),
            None => self.empty.push((id, vec![used])),
        }
    }
}
