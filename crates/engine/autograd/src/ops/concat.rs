//! Concatenation along an axis.

use crate::{Backward, Op, Pool, Shape, ShapeError, Shapes, Var, View, ViewMut, ensure_shape};
use weaver_kernels::{Real, rows::copy_blocks};

#[derive(Debug)]
struct Concat {
    axis: usize,
}

impl Concat {
    /// Calls `each` with the index of every input that is not empty, and its start and length in a row of the output.
    fn parts<T>(&self, ins: &[View<'_, T>], mut each: impl FnMut(usize, usize, usize)) {
        let mut start = 0;
        for (i, x) in ins.iter().enumerate() {
            let [_, len, inner] = x.shape().around(self.axis);
            if !x.is_empty() {
                each(i, start, len * inner);
            }
            start += len * inner;
        }
    }
}

impl<T: Real> Op<T> for Concat {
    fn name(&self) -> &'static str {
        "concat"
    }
    fn shapes(&self, ins: &[Shape]) -> Result<Shapes, ShapeError> {
        let axis = self.axis;
        ensure_shape!(!ins.is_empty() && axis < ins[0].rank(), "at least one tensor, with an axis {axis}");
        let rest = |s: &Shape| s.with_axis(axis, 0);
        ensure_shape!(
            ins.iter().all(|s| s.rank() == ins[0].rank() && rest(s) == rest(&ins[0])),
            "shapes that differ along axis {axis} alone"
        );
        Ok(Shapes::one(ins[0].with_axis(axis, ins.iter().map(|s| s[axis]).sum())))
    }
    fn forward(&mut self, ins: &[View<'_, T>], outs: &mut [ViewMut<'_, T>], _pool: &Pool) {
        let [outer, len, inner] = outs[0].shape().around(self.axis);
        self.parts(ins, |i, start, width| {
            copy_blocks(outer, width, &ins[i], width, (&mut outs[0][start..], T::ZERO), len * inner);
        });
    }
    fn backward(&self, at: Backward<'_, '_, T>) {
        let Backward { ins, outs, douts, dins, .. } = at;
        let [outer, len, inner] = outs[0].shape().around(self.axis);
        self.parts(ins, |i, start, width| {
            if let Some(dx) = &mut dins[i] {
                copy_blocks(outer, width, &douts[0][start..], len * inner, dx.target(), width);
            }
        });
    }
}

/// Concatenates tensors along an axis: `[.., a_i, ..]` give `[.., sum of a_i, ..]`. All other dimensions must agree.
/// Differentiable in all inputs.
///
/// ```
/// use weaver_autograd::{Tape, ops};
/// let tape = Tape::<f32>::new();
/// let (a, b) = (tape.constant(&[1.0, 2.0], [2, 1]), tape.constant(&[3.0, 4.0, 5.0, 6.0], [2, 2]));
/// assert_eq!(ops::concat(&[a, b], 1).to_vec(), [1.0, 3.0, 4.0, 2.0, 5.0, 6.0]);
/// ```
#[track_caller]
pub fn concat<'t, T: Real>(inputs: &[Var<'t, T>], axis: usize) -> Var<'t, T> {
    let first = inputs.first().expect("concat needs at least one tensor");
    let [y] = first.tape().apply(Concat { axis }, inputs);
    y
}
