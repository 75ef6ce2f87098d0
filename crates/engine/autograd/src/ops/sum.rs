//! The sum of all elements.

use crate::{Backward, Op, Pool, Shape, ShapeError, Shapes, Var, View, ViewMut, ensure_shape};
use weaver_kernels::Real;

#[derive(Debug)]
struct Sum;

impl<T: Real> Op<T> for Sum {
    fn name(&self) -> &'static str {
        "sum"
    }
    fn shapes(&self, ins: &[Shape]) -> Result<Shapes, ShapeError> {
        ensure_shape!(ins.len() == 1, "one input");
        Ok(Shapes::one(Shape::SCALAR))
    }
    fn forward(&mut self, ins: &[View<'_, T>], outs: &mut [ViewMut<'_, T>], _pool: &Pool) {
        // In f64 and in order: losses are compared across runs to the last bit.
        outs[0][0] = T::from_f64(ins[0].iter().map(|x| x.to_f64()).sum());
    }
    fn backward(&self, at: Backward<'_, '_, T>) {
        let Backward { douts, dins, .. } = at;
        if let Some(dx) = &mut dins[0] {
            dx.add_each(|_| douts[0][0]);
        }
    }
}

impl<'t, T: Real> Var<'t, T> {
    /// The sum of all elements, accumulated in `f64` and in order.
    ///
    /// x of any shape gives a scalar, 0 if x is empty. Differentiable.
    ///
    /// ```
    /// use weaver_autograd::Tape;
    /// let tape = Tape::<f32>::new();
    /// assert_eq!(tape.constant(&[1.0, 2.0, 6.0], [3]).sum().item(), 9.0);
    /// ```
    pub fn sum(self) -> Self {
        let [y] = self.tape().apply(Sum, &[self]);
        y
    }

    /// The mean of all elements.
    ///
    /// x of any shape gives a scalar, NaN if x is empty. Differentiable.
    ///
    /// ```
    /// use weaver_autograd::Tape;
    /// let tape = Tape::<f32>::new();
    /// assert_eq!(tape.constant(&[1.0, 3.0], [2]).mean().item(), 2.0);
    /// ```
    pub fn mean(self) -> Self {
        let count = self.shape().len();
        self.sum() * (1.0 / count as f64)
    }
}
