//! The backward pass over the tape.

use super::{List, Record, Tape, ValueId};
use crate::op::{Backward, Grad, View};
use crate::profile::Phase;
use crate::{Buffer, Shape};
use std::ops::Deref;
use weaver_kernels::Real;

/// The gradient of the loss with respect to an output.
enum Cotangent<'a, T: Real> {
    /// The initial values of the walk, where nothing is to be added to them: no copy.
    Given(&'a [T]),
    Summed(Buffer<T>),
}

impl<T: Real> Deref for Cotangent<'_, T> {
    type Target = [T];
    fn deref(&self) -> &[T] {
        match self {
            Self::Given(values) => values,
            Self::Summed(buffer) => buffer,
        }
    }
}

impl<T: Real> Tape<T> {
    /// Walks back from `root`, whose own gradient is `seed`.
    #[inline(never)]
    pub(crate) fn backward_from(&self, root: ValueId, seed: &[T]) {
        let Record { values, output_shapes, nodes, inputs, paths, .. } = &mut *self.record.borrow_mut();
        let start = &mut values[root as usize];
        let mut given = None;
        match &mut start.grad {
            Some(sum) => sum.iter_mut().zip(seed).for_each(|(s, g)| *s += *g),
            empty if start.leaf || start.retained || start.auxiliary => *empty = Some(self.pool.copy_of(seed)),
            None => given = Some(seed),
        }
        for node in nodes.iter().rev() {
            let begins = given.is_some() && node.outputs.contains(&root);
            if !begins && node.outputs.clone().all(|o| values[o as usize].grad.is_none()) {
                continue;
            }
            let op = node.op.op();
            let name = op.name();
            let path = &paths[node.path.start as usize..node.path.end as usize];
            let node_inputs = &inputs[node.inputs.start as usize..node.inputs.end as usize];

            let out_range = node.outputs.start as usize..node.outputs.end as usize;
            let cotangents: List<Option<Cotangent<'_, T>>> = out_range
                .clone()
                .map(|o| {
                    let value = &mut values[o];
                    if o == root as usize
                        && let Some(seed) = given.take()
                    {
                        return Some(match value.grad.take() {
                            None => Cotangent::Given(seed),
                            Some(mut sum) => {
                                sum.iter_mut().zip(seed).for_each(|(s, g)| *s += *g);
                                Cotangent::Summed(sum)
                            }
                        });
                    }
                    if value.auxiliary {
                        assert!(
                            value.grad.is_none(),
                            "{path}: a gradient reached an auxiliary output of `{name}`, which has none; detach() it"
                        );
                        return None;
                    }
                    let zeros = || self.pool.filled(value.storage.as_slice().len(), T::ZERO);
                    Some(Cotangent::Summed(value.grad.take().unwrap_or_else(zeros)))
                })
                .collect();

            // Slots of the inputs' gradients, taken out of the values so that these can be read meanwhile. An input
            // that occurs twice gets a slot of its own each time; they are added below.
            let mut slots: List<Option<(Buffer<T>, bool)>> = List::new();
            for (i, input) in node_inputs.iter().enumerate() {
                let slot = input.tracked.then(|| {
                    assert!(
                        op.differentiable(i),
                        "{path}: `{name}` has no gradient with respect to input {i}; detach() it if none is meant"
                    );
                    match values[input.id as usize].grad.take() {
                        Some(grad) => (grad, false),
                        None => (self.pool.buffer(input.shape.len()), true),
                    }
                });
                slots.push(slot);
            }
            {
                let view = |id: u32, shape: Shape| values[id as usize].storage.view(shape);
                let ins: List<View<'_, T>> = node_inputs.iter().map(|i| view(i.id, i.shape)).collect();
                let outs: List<View<'_, T>> = out_range.clone().map(|o| view(o as u32, output_shapes[o])).collect();
                let douts: List<View<'_, T>> = out_range
                    .clone()
                    .zip(&cotangents)
                    .map(|(o, c)| c.as_ref().map_or(View::nothing(), |c| View::new(c, output_shapes[o])))
                    .collect();
                let mut dins: List<Option<Grad<'_, T>>> =
                    slots.iter_mut().map(|s| s.as_mut().map(|(grad, first)| Grad::new(grad, *first))).collect();
                if outs.iter().any(|out| !out.is_empty()) {
                    let began = self.began();
                    op.backward(Backward { ins: &ins, outs: &outs, douts: &douts, dins: &mut dins, pool: &self.pool });
                    self.ended(began, name, Phase::Backward, path);
                } else {
                    dins.iter_mut().flatten().for_each(Grad::add_zero);
                }
                for (i, grad) in dins.iter().enumerate() {
                    assert!(
                        grad.as_ref().is_none_or(Grad::is_written),
                        "{path}: `{name}` did not write the gradient of input {i}"
                    );
                }
            }
            for (input, slot) in node_inputs.iter().zip(slots) {
                let Some((grad, _)) = slot else { continue };
                match &mut values[input.id as usize].grad {
                    Some(sum) => sum.iter_mut().zip(grad.iter()).for_each(|(s, g)| *s += *g),
                    empty => *empty = Some(grad),
                }
            }
            for (o, cotangent) in out_range.zip(cotangents) {
                let value = &mut values[o];
                if let Some(Cotangent::Summed(sum)) = cotangent.filter(|_| value.retained) {
                    match &mut value.kept {
                        Some(kept) => kept.iter_mut().zip(sum.iter()).for_each(|(kept, g)| *kept += *g),
                        empty => *empty = Some(sum),
                    }
                }
            }
        }
    }
}
