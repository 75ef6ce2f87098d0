//! Gradient checkpointing: recomputation trades time for memory.

use crate::tape::{List, Surroundings};
use crate::{Backward, Buffer, Grad, Op, ParamId, Params, Pool, Shape, ShapeError, Shapes, Tape, Var, View, ViewMut};
use smallvec::SmallVec;
use std::fmt;
use weaver_kernels::{Real, parallel};

struct Checkpoint<T: Real, F> {
    function: F,
    params: Params<T>,
    /// The parameters that the function uses, which follow the function's own inputs among the inputs of the op.
    used: SmallVec<[ParamId; 32]>,
    /// The result of the function, until the forward pass copies it to the output.
    result: Option<Buffer<T>>,
    shape: Shape,
    around: Surroundings,
}

impl<T: Real, F> fmt::Debug for Checkpoint<T, F> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "Checkpoint {} of {} parameters", self.shape, self.used.len())
    }
}

impl<T: Real, F> Op<T> for Checkpoint<T, F>
where
    F: for<'a> Fn(&'a Tape<T>, &'a Params<T>, &[Var<'a, T>]) -> Var<'a, T> + Send + 'static,
{
    fn name(&self) -> &'static str {
        "checkpoint"
    }
    fn shapes(&self, _ins: &[Shape]) -> Result<Shapes, ShapeError> {
        Ok(Shapes::one(self.shape))
    }
    fn forward(&mut self, _ins: &[View<'_, T>], outs: &mut [ViewMut<'_, T>], _pool: &Pool) {
        parallel::copy(&self.result.take().expect("forward runs once"), &mut outs[0]);
    }
    fn backward(&self, at: Backward<'_, '_, T>) {
        let Backward { ins, douts, dins, pool, .. } = at;
        let tape = Tape::nested(&self.around, pool.clone(), true);
        let own = ins.len() - self.used.len();
        let source = |(i, x): (usize, &View<'_, T>)| match dins[i] {
            Some(_) => tape.leaf(x, x.shape()),
            None => tape.constant(x, x.shape()),
        };
        let mut sources: List<Var<'_, T>> = ins[..own].iter().enumerate().map(source).collect();
        sources.extend(self.used.iter().map(|id| tape.param(&self.params, *id)));
        // The inner backward pass adds to existing sums, in the order it would without recomputation.
        for (x, din) in sources.iter().zip(dins.iter()) {
            if let Some(so_far) = din.as_ref().and_then(Grad::so_far) {
                tape.set_grad(x.id(), so_far);
            }
        }
        let y = (self.function)(&tape, &self.params, &sources[..own]);
        if y.is_tracked() {
            y.backward_with(&douts[0]);
        }
        for (x, din) in sources.iter().zip(dins) {
            let Some(din) = din else { continue };
            match tape.grad(x.id()) {
                Some(gradient) => parallel::copy(&gradient, din.target().0),
                None => din.add_zero(),
            }
        }
    }
}

/// Gradient checkpointing: runs `function` without keeping its intermediate tensors, and runs it again in the backward
/// pass (Chen et al., arXiv 1604.06174). The gradients are the same bits as without a checkpoint.
///
/// `inputs` must not be empty. The function gets a tape of its own, the parameters, and the inputs as tensors on that
/// tape; it must be pure, since it is called twice. Differentiable in the inputs and in every parameter that the
/// function uses. Each of the two runs sets up a tape, which allocates a little; tensors come from the pool.
///
/// ```
/// use weaver_autograd::{Params, Tape, ops};
/// let mut params = Params::<f64>::new();
/// let w = params.add("w", [1], vec![3.0]);
/// let tape = Tape::new();
/// let x = tape.leaf(&[2.0], [1]);
/// let y = ops::checkpoint(&params, &[x], move |tape, params, x| (x[0] * tape.param(params, w)).square());
/// y.backward();
/// assert_eq!((y.item(), x.grad().unwrap()[0], tape.param_grad(w).unwrap()[0]), (36.0, 36.0, 24.0));
/// ```
#[track_caller]
pub fn checkpoint<'t, T: Real, F>(params: &Params<T>, inputs: &[Var<'t, T>], function: F) -> Var<'t, T>
where
    F: for<'a> Fn(&'a Tape<T>, &'a Params<T>, &[Var<'a, T>]) -> Var<'a, T> + Send + 'static,
{
    let tape = inputs.first().expect("checkpoint needs at least one input").tape();
    let around = tape.surroundings();
    let inner = Tape::nested(&around, tape.pool().clone(), false);
    let constants: List<Var<'_, T>> = inputs.iter().map(|x| inner.constant(&x.value(), x.shape())).collect();
    let y = tape.timed("checkpointed", || inner.without_gradient(|| function(&inner, params, &constants)));
    let used: SmallVec<[ParamId; 32]> = params.ids().filter(|id| inner.uses(*id)).collect();
    let mut all: SmallVec<[Var<'t, T>; 32]> = inputs.iter().copied().collect();
    all.extend(used.iter().map(|id| tape.param(params, *id)));
    let result = Some(tape.pool().copy_of(&y.value()));
    let op = Checkpoint { function, params: params.clone(), used, result, shape: y.shape(), around };
    let [y] = tape.apply(op, &all);
    y
}
