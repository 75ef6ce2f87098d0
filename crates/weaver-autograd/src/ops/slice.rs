//! A range of indices along an axis.

use super::blocks::{Columns, around, copy_columns};
use crate::{Grad, List, Op, Pool, Shape, ShapeError, Shapes, Var, View, ViewMut, ensure_shape};
use weaver_kernels::Real;

#[derive(Debug)]
struct Slice {
    axis: usize,
    start: usize,
    len: usize,
}

impl Slice {
    /// The slice as a block of columns of the input.
    fn columns(&self, input: Shape) -> (Columns, usize) {
        let [_, len, inner] = around(input, self.axis);
        (Columns { pitch: len * inner, start: self.start * inner }, self.len * inner)
    }
}

impl<T: Real> Op<T> for Slice {
    fn name(&self) -> &'static str {
        "slice"
    }
    fn shapes(&self, ins: &[Shape]) -> Result<Shapes, ShapeError> {
        let Self { axis, start, len } = *self;
        ensure_shape!(
            ins.len() == 1 && axis < ins[0].rank() && start + len <= ins[0][axis],
            "a tensor that holds {start}..{} along axis {axis}",
            start + len
        );
        Ok(Shapes::one(ins[0].with_axis(axis, len)))
    }
    fn forward(&mut self, ins: &[View<'_, T>], outs: &mut [ViewMut<'_, T>], _pool: &Pool) {
        let (from, width) = self.columns(ins[0].shape());
        copy_columns(&ins[0], from, &mut outs[0], Columns { pitch: width, start: 0 }, width, T::ZERO);
    }
    fn backward(
        &self,
        ins: &[View<'_, T>],
        _outs: &[View<'_, T>],
        douts: &[View<'_, T>],
        dins: &mut [Option<Grad<'_, T>>],
        _pool: &Pool,
    ) {
        if let Some(dx) = &mut dins[0] {
            let (to, width) = self.columns(ins[0].shape());
            copy_columns(&douts[0], Columns { pitch: width, start: 0 }, dx.accumulator(), to, width, T::ONE);
        }
    }
}

impl<'t, T: Real> Var<'t, T> {
    /// Indices `start..start + len` along an axis: `[.., A, ..]` gives `[.., len, ..]`.
    #[track_caller]
    pub fn slice(self, axis: usize, start: usize, len: usize) -> Self {
        let [y] = self.tape().apply(Slice { axis, start, len }, &[self]);
        y
    }
}

/// Cuts a tensor along an axis into consecutive parts of the given sizes, which add up to its length.
#[track_caller]
pub fn split<'t, T: Real>(x: Var<'t, T>, axis: usize, sizes: &[usize]) -> List<Var<'t, T>> {
    assert!(
        axis < x.shape().rank() && sizes.iter().sum::<usize>() == x.shape()[axis],
        "split: {} cannot be cut along axis {axis} into {sizes:?}",
        x.shape()
    );
    let mut start = 0;
    let cut = |&len: &usize| {
        start += len;
        x.slice(axis, start - len, len)
    };
    sizes.iter().map(cut).collect()
}
