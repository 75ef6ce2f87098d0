//! A range of indices along an axis.

use crate::{Backward, List, Op, Pool, Shape, ShapeError, Shapes, Var, View, ViewMut, ensure_shape};
use weaver_kernels::{Real, rows::copy_blocks};

#[derive(Debug)]
struct Slice {
    axis: usize,
    start: usize,
    len: usize,
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
        let [outer, len, inner] = ins[0].shape().around(self.axis);
        let width = self.len * inner;
        copy_blocks(
            outer,
            width,
            &ins[0][(self.start * inner).min(ins[0].len())..],
            len * inner,
            (&mut outs[0], T::ZERO),
            width,
        );
    }
    fn backward(&self, at: Backward<'_, '_, T>) {
        let Backward { ins, douts, dins, .. } = at;
        if let Some(dx) = &mut dins[0] {
            let [outer, len, inner] = ins[0].shape().around(self.axis);
            let (width, start) = (self.len * inner, self.start * inner);
            let dx = &mut dx.accumulator()[start.min(ins[0].len())..];
            copy_blocks(outer, width, &douts[0], width, (dx, T::ONE), len * inner);
        }
    }
}

impl<'t, T: Real> Var<'t, T> {
    /// The part `start..start + len` of the tensor along an axis. Copies the elements.
    ///
    /// x `[.., A, ..]` gives `[.., len, ..]`. Differentiable. Panics if the range ends beyond A.
    ///
    /// ```
    /// use weaver_autograd::Tape;
    /// let tape = Tape::<f32>::new();
    /// let x = tape.constant(&[1.0, 2.0, 3.0, 4.0, 5.0, 6.0], [2, 3]);
    /// assert_eq!(x.slice(1, 1, 2).to_vec(), [2.0, 3.0, 5.0, 6.0]);
    /// ```
    #[track_caller]
    pub fn slice(self, axis: usize, start: usize, len: usize) -> Self {
        let [y] = self.tape().apply(Slice { axis, start, len }, &[self]);
        y
    }
}

/// Splits a tensor along an axis into consecutive parts of the given sizes, each a [`slice`](Var::slice).
///
/// x `[.., A, ..]` gives `[.., sizes[i], ..]` for every i. Differentiable. Panics if the sizes do not add up to A.
///
/// ```
/// use weaver_autograd::{Tape, ops};
/// let tape = Tape::<f32>::new();
/// let parts = ops::split(tape.constant(&[1.0, 2.0, 3.0], [3]), 0, &[1, 2]);
/// assert_eq!((parts[0].to_vec(), parts[1].to_vec()), (vec![1.0], vec![2.0, 3.0]));
/// ```
#[track_caller]
pub fn split<'t, T: Real>(x: Var<'t, T>, axis: usize, sizes: &[usize]) -> List<Var<'t, T>> {
    let fits = axis < x.shape().rank() && sizes.iter().sum::<usize>() == x.shape()[axis];
    let expected = format_args!("a tensor that parts of {sizes:?} fill along axis {axis}");
    x.tape().ensure_shapes(fits, "split", expected, &[x.shape()]);
    let mut start = 0;
    let cut = |&len: &usize| {
        start += len;
        x.slice(axis, start - len, len)
    };
    sizes.iter().map(cut).collect()
}
