//! The tape: records ops as they run, owns all values and gradients, and computes the backward pass.

use crate::op::View;
use crate::params::{HalfValues, Param, ParamValues};
use crate::profile::{Profile, Tracer};
use crate::recycle::{OpBoxes, Slot};
use crate::{Buffer, Pool, Shape, Var};
use smallvec::SmallVec;
use std::cell::{Cell, Ref, RefCell};
use std::sync::Arc;
use weaver_kernels::Real;

mod apply;
mod backward;
mod measure;
mod nested;
mod parameters;
mod part;
mod path;

pub use measure::NodeView;
pub(crate) use nested::Surroundings;
pub use part::{Outputs, Steps};

/// Index of a value on the tape.
pub(crate) type ValueId = u32;

/// A list with inline storage for the usual number of inputs and outputs; longer lists are on the heap.
pub type List<X> = SmallVec<[X; 8]>;

enum Storage<T: Real> {
    Pooled(Buffer<T>),
    Shared(Arc<dyn AsRef<[T]> + Send + Sync>),
    Half(HalfValues),
    /// Given back; see [`Tape::part`].
    Released,
}

impl<T: Real> Storage<T> {
    /// The values of a parameter.
    fn of(param: &Param<T>) -> Self {
        match param.values() {
            ParamValues::Owned(values) => Self::Shared(values.clone()),
            ParamValues::Shared(values) => Self::Shared(values.clone()),
            ParamValues::Half(values) => Self::Half(values.clone()),
            ParamValues::Absent => panic!("parameter {} has no values yet", param.name()),
        }
    }

    fn as_slice(&self) -> &[T] {
        match self {
            Self::Pooled(buffer) => buffer,
            Self::Shared(data) => (**data).as_ref(),
            Self::Half(_) => panic!("a parameter in half precision is read by the layer that multiplies by it alone"),
            Self::Released => panic!(
                "this value was computed in a part of the model that did not return it; it was given back, since nothing is recorded"
            ),
        }
    }

    fn view(&self, shape: Shape) -> View<'_, T> {
        match self {
            Self::Half(data) => View::of_half(data.view(), shape),
            _ => View::new(self.as_slice(), shape),
        }
    }
}

struct Value<T: Real> {
    storage: Storage<T>,
    /// True if a gradient may flow to or through this value.
    tracked: bool,
    /// Leaves keep their gradient after the backward pass.
    leaf: bool,
    /// True if gradients that pass through are added to `kept`.
    retained: bool,
    /// True if this is an auxiliary output; a gradient that reaches it is an error that names the op.
    auxiliary: bool,
    /// The gradient so far: passed on by the backward pass, or the result for a leaf.
    grad: Option<Buffer<T>>,
    kept: Option<Buffer<T>>,
}

#[derive(Clone, Copy)]
struct Input {
    id: ValueId,
    shape: Shape,
    tracked: bool,
}

struct Node<T: Real> {
    op: Box<dyn Slot<T>>,
    inputs: std::ops::Range<u32>,
    outputs: std::ops::Range<u32>,
    path: std::ops::Range<u32>,
    /// Bytes of its outputs and its saved state.
    held: usize,
}

struct Record<T: Real> {
    values: Vec<Value<T>>,
    output_shapes: Vec<Shape>,
    nodes: Vec<Node<T>>,
    inputs: Vec<Input>,
    /// Text of the paths at which nodes were recorded, end to end.
    paths: String,
    /// The paths in force, end to end: the last one counts, from `path_start` on.
    path: String,
    path_start: usize,
    params: Vec<Option<ValueId>>,
    boxes: OpBoxes<T>,
    watcher: Option<Watcher>,
}

/// Called with the path of each part of a model that is done.
type Watcher = Box<dyn Fn(&str) + Send>;

/// A define-by-run tape over pooled memory.
///
/// Ops run when they are applied and are recorded; [`Var::backward`] computes the gradients of every leaf that a result
/// depends on. [`reset`](Tape::reset) clears the record and keeps the memory in the pool for the next step. A [`Var`]
/// borrows the tape, so one that outlives its step does not compile.
///
/// ```
/// use weaver_autograd::Tape;
/// let mut tape = Tape::<f64>::new();
/// let x = tape.leaf(&[1.0, 2.0, 3.0], [3]);
/// let loss = (x * x).sum();
/// loss.backward();
/// assert_eq!(x.grad().unwrap(), [2.0, 4.0, 6.0]);
/// tape.reset();
/// ```
pub struct Tape<T: Real = f32> {
    record: RefCell<Record<T>>,
    pool: Pool,
    /// True if applied ops are kept for a backward pass.
    recording: Cell<bool>,
    profile: RefCell<Option<Profile>>,
    tracer: Tracer,
    /// True if this tape recomputes an earlier forward pass.
    again: bool,
}

impl<T: Real> Default for Tape<T> {
    fn default() -> Self {
        Self::new()
    }
}

impl<T: Real> std::fmt::Debug for Tape<T> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let record = self.record.borrow();
        f.debug_list().entries(record.nodes.iter().map(|n| n.op.op())).finish()
    }
}

impl<T: Real> Tape<T> {
    /// Creates an empty tape with a pool of its own.
    pub fn new() -> Self {
        Self::with_pool(Pool::new())
    }

    /// Creates an empty tape that shares a pool.
    #[inline(never)]
    pub fn with_pool(pool: Pool) -> Self {
        let record = Record {
            values: Vec::new(),
            output_shapes: Vec::new(),
            nodes: Vec::new(),
            inputs: Vec::new(),
            paths: String::new(),
            path: String::new(),
            path_start: 0,
            params: Vec::new(),
            boxes: OpBoxes::default(),
            watcher: None,
        };
        Self {
            record: RefCell::new(record),
            pool,
            recording: Cell::new(true),
            profile: RefCell::new(None),
            tracer: Tracer::default(),
            again: false,
        }
    }

    /// The pool that the tape's memory comes from.
    pub fn pool(&self) -> &Pool {
        &self.pool
    }

    /// Removes all values and ops and returns their memory to the pool. The exclusive borrow ensures that no [`Var`]
    /// survives.
    #[inline(never)]
    pub fn reset(&mut self) {
        let record = self.record.get_mut();
        for node in record.nodes.drain(..) {
            record.boxes.put(node.op);
        }
        record.values.clear();
        record.output_shapes.clear();
        record.inputs.clear();
        record.paths.clear();
        record.params.clear();
    }

    /// Creates a constant, a tensor without a gradient, from a copy of `data`.
    pub fn constant(&self, data: &[T], shape: impl Into<Shape>) -> Var<'_, T> {
        let shape = self.checked(data.len(), shape);
        let value = Storage::Pooled(self.pool.copy_of(data));
        self.push_source(value, shape, false)
    }

    /// Creates a constant that shares its memory, such as the weights of a network that is not trained.
    pub fn shared_constant(&self, data: &Arc<Vec<T>>, shape: impl Into<Shape>) -> Var<'_, T> {
        let shape = self.checked(data.len(), shape);
        self.push_source(Storage::Shared(data.clone()), shape, false)
    }

    /// Creates a constant of zeros and lets `f` fill it in.
    pub fn constant_with(&self, shape: impl Into<Shape>, f: impl FnOnce(&mut [T])) -> Var<'_, T> {
        let shape = shape.into();
        let mut buffer = self.pool.filled(shape.len(), T::ZERO);
        f(&mut buffer);
        self.push_source(Storage::Pooled(buffer), shape, false)
    }

    /// Creates a constant from a buffer, without a copy.
    pub fn constant_of(&self, buffer: Buffer<T>, shape: impl Into<Shape>) -> Var<'_, T> {
        let shape = self.checked(buffer.len(), shape);
        self.push_source(Storage::Pooled(buffer), shape, false)
    }

    /// Creates a constant scalar.
    pub fn scalar(&self, x: T) -> Var<'_, T> {
        self.constant(&[x], Shape::SCALAR)
    }

    /// Creates a leaf, a tensor whose gradient the backward pass computes, from a copy of `data`.
    pub fn leaf(&self, data: &[T], shape: impl Into<Shape>) -> Var<'_, T> {
        let shape = self.checked(data.len(), shape);
        let value = Storage::Pooled(self.pool.copy_of(data));
        self.push_source(value, shape, true)
    }

    /// Runs `f` without recording: nothing it computes can be differentiated, and no op is kept.
    pub fn without_gradient<R>(&self, f: impl FnOnce() -> R) -> R {
        let before = self.recording.replace(false);
        let result = f();
        self.recording.set(before);
        result
    }

    fn checked(&self, len: usize, shape: impl Into<Shape>) -> Shape {
        let shape = shape.into();
        self.ensure_shapes(
            len == shape.len(),
            "source",
            format_args!("{} numbers for {shape}", shape.len()),
            &[[len].into()],
        );
        shape
    }

    #[inline(never)]
    fn push_source(&self, storage: Storage<T>, shape: Shape, tracked: bool) -> Var<'_, T> {
        let record = &mut *self.record.borrow_mut();
        let id = record.values.len() as ValueId;
        let (leaf, retained, auxiliary) = (tracked, false, false);
        record.values.push(Value { storage, tracked, leaf, retained, auxiliary, grad: None, kept: None });
        record.output_shapes.push(shape);
        Var::new(self, id, shape, tracked)
    }

    pub(crate) fn value(&self, id: ValueId) -> Ref<'_, [T]> {
        Ref::map(self.record.borrow(), |r| r.values[id as usize].storage.as_slice())
    }

    pub(crate) fn grad(&self, id: ValueId) -> Option<Ref<'_, [T]>> {
        Ref::filter_map(self.record.borrow(), |r| {
            let value = &r.values[id as usize];
            if value.retained { value.kept.as_deref() } else { value.grad.as_deref() }
        })
        .ok()
    }

    /// Sets the initial gradient of a leaf.
    pub(crate) fn set_grad(&self, id: ValueId, gradient: &[T]) {
        self.record.borrow_mut().values[id as usize].grad = Some(self.pool.copy_of(gradient));
    }

    /// Keeps the gradient of an intermediate value after the backward pass.
    pub(crate) fn retain(&self, id: ValueId) {
        let value = &mut self.record.borrow_mut().values[id as usize];
        value.retained = !value.leaf;
    }
}
