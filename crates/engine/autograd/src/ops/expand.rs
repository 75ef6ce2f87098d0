//! Broadcasting to a larger shape.

use super::strided::{Strided, contiguous};
use crate::{Backward, MAX_RANK, Op, Pool, Shape, ShapeError, Shapes, Var, View, ViewMut, ensure_shape};
use weaver_kernels::Real;

#[derive(Debug)]
struct Expand {
    shape: Shape,
}

impl Expand {
    /// The strides of the input along the axes of the output, 0 along repeated axes.
    fn strided(&self, input: Shape) -> Strided {
        let added = self.shape.rank() - input.rank();
        let from = contiguous(input);
        let mut strides = [0; MAX_RANK];
        for axis in 0..input.rank() {
            strides[added + axis] = if input[axis] == 1 { 0 } else { from[axis] };
        }
        Strided::new(self.shape, &strides[..self.shape.rank()])
    }
}

impl<T: Real> Op<T> for Expand {
    fn name(&self) -> &'static str {
        "expand"
    }
    fn shapes(&self, ins: &[Shape]) -> Result<Shapes, ShapeError> {
        let shape = self.shape;
        let fits = |x: Shape| {
            x.rank() <= shape.rank()
                && x.dims().iter().rev().zip(shape.dims().iter().rev()).all(|(&from, &to)| from == to || from == 1)
        };
        ensure_shape!(ins.len() == 1 && fits(ins[0]), "a tensor that broadcasts to {shape}");
        Ok(Shapes::one(shape))
    }
    fn forward(&mut self, ins: &[View<'_, T>], outs: &mut [ViewMut<'_, T>], _pool: &Pool) {
        self.strided(ins[0].shape()).gather(&ins[0], &mut outs[0]);
    }
    fn backward(&self, at: Backward<'_, '_, T>) {
        let Backward { ins, douts, dins, .. } = at;
        if let Some(dx) = &mut dins[0] {
            self.strided(ins[0].shape()).scatter_add(&douts[0], dx.accumulator());
        }
    }
}

impl<'t, T: Real> Var<'t, T> {
    /// Repeats the tensor along new leading axes and along axes of length 1, by NumPy's rules of broadcasting.
    ///
    /// The last axes of x must agree with `shape` or have length 1. Differentiable; the gradient is summed over
    /// repetitions.
    ///
    /// ```
    /// use weaver_autograd::Tape;
    /// let tape = Tape::<f32>::new();
    /// assert_eq!(tape.constant(&[1.0, 2.0], [2, 1]).expand([2, 2]).to_vec(), [1.0, 1.0, 2.0, 2.0]);
    /// ```
    #[track_caller]
    pub fn expand(self, shape: impl Into<Shape>) -> Self {
        let [y] = self.tape().apply(Expand { shape: shape.into() }, &[self]);
        y
    }
}
