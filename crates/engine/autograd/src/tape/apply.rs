//! Applying ops.

use super::{Input, List, Node, Storage, Tape, Value};
use crate::op::{Op, View, ViewMut};
use crate::profile::Phase;
use crate::recycle::Slot;
use crate::{Buffer, Shape, ShapeError, Shapes, Var};
use weaver_kernels::Real;

impl<T: Real> Tape<T> {
    /// Applies an op.
    ///
    /// # Panics
    ///
    /// If the shapes of the inputs do not fit, with the name of the op, the model path and the shapes.
    #[track_caller]
    pub fn apply<'t, O: Op<T>, const N: usize>(&'t self, op: O, inputs: &[Var<'t, T>]) -> [Var<'t, T>; N] {
        let outputs = self.try_apply(op, inputs).unwrap_or_else(|error| panic!("{error}"));
        let count = outputs.len();
        outputs
            .into_iter()
            .collect::<List<_>>()
            .as_slice()
            .try_into()
            .unwrap_or_else(|_| panic!("the op has {count} outputs, not {N}"))
    }

    /// Applies an op, or returns an error if the shapes of the inputs do not fit.
    // Crates link this instead of compiling the op again; the code that does not depend on the type of the op is
    // compiled once for all ops.
    #[inline(never)]
    pub fn try_apply<'t, O: Op<T>>(&'t self, mut op: O, inputs: &[Var<'t, T>]) -> Result<List<Var<'t, T>>, ShapeError> {
        let used = self.pool.used_bytes();
        let outputs = self.run(&mut op, inputs)?;
        let auxiliary = op.auxiliary_outputs();
        let tracked = self.recording.get() && inputs.iter().any(Var::is_tracked);
        let recorded = tracked.then(|| self.record.borrow_mut().boxes.store(op));
        Ok(self.push_outputs(recorded, inputs, outputs, auxiliary, used))
    }

    /// Computes the outputs of an op.
    #[inline(never)]
    fn run(&self, op: &mut dyn Op<T>, inputs: &[Var<'_, T>]) -> Result<(List<Buffer<T>>, Shapes), ShapeError> {
        let name = op.name();
        for var in inputs {
            assert!(std::ptr::eq(var.tape(), self), "{name}: an input belongs to another tape");
        }
        let in_shapes: List<Shape> = inputs.iter().map(Var::shape).collect();
        let shapes = op.shapes(&in_shapes).map_err(|error| self.located(error, name, &in_shapes))?;
        let mut outputs: List<Buffer<T>> = shapes.iter().map(|s| self.pool.buffer(s.len())).collect();
        let record = self.record.borrow();
        let ins: List<View<'_, T>> =
            inputs.iter().map(|v| record.values[v.id() as usize].storage.view(v.shape())).collect();
        for (i, view) in ins.iter().enumerate().filter(|(_, view)| view.half().is_some()) {
            let (path, shape) = (record.path(), view.shape());
            assert!(op.reads_half(i), "{path}: `{name}` cannot read input {i}, {shape} in half precision");
        }
        let mut outs: List<ViewMut<'_, T>> =
            outputs.iter_mut().zip(shapes.iter()).map(|(b, s)| ViewMut::new(b, *s)).collect();
        if outs.iter().any(|out| !out.is_empty()) {
            let began = self.began();
            op.forward(&ins, &mut outs, &self.pool);
            self.ended(began, name, Phase::Forward, record.path());
        }
        drop(outs);
        Ok((outputs, shapes))
    }

    /// Adds the outputs of an op, the last `auxiliary` without a gradient, and the op, if it is recorded. `used` is how
    /// many bytes of the pool were in use before it ran.
    #[inline(never)]
    fn push_outputs<'t>(
        &'t self,
        op: Option<Box<dyn Slot<T>>>,
        inputs: &[Var<'t, T>],
        (outputs, shapes): (List<Buffer<T>>, Shapes),
        auxiliary: usize,
        used: usize,
    ) -> List<Var<'t, T>> {
        let tracked = op.is_some();
        let differentiable = shapes.len() - auxiliary;
        let record = &mut *self.record.borrow_mut();
        let first = record.values.len() as u32;
        for (i, buffer) in outputs.into_iter().enumerate() {
            record.values.push(Value {
                storage: Storage::Pooled(buffer),
                tracked,
                leaf: false,
                retained: false,
                auxiliary: i >= differentiable,
                grad: None,
                kept: None,
            });
            record.output_shapes.push(shapes[i]);
        }
        if let Some(op) = op {
            let inputs_start = record.inputs.len() as u32;
            record.inputs.extend(inputs.iter().map(|v| Input {
                id: v.id(),
                shape: v.shape(),
                tracked: v.is_tracked(),
            }));
            let path_start = record.paths.len() as u32;
            record.paths.push_str(&record.path[record.path_start..]);
            record.nodes.push(Node {
                op,
                inputs: inputs_start..record.inputs.len() as u32,
                outputs: first..record.values.len() as u32,
                path: path_start..record.paths.len() as u32,
                // An op may also have returned memory that it came with.
                held: self.pool.used_bytes().saturating_sub(used),
            });
        }
        shapes.iter().enumerate().map(|(i, s)| Var::new(self, first + i as u32, *s, tracked)).collect()
    }
}
