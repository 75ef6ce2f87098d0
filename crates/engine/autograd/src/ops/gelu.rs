//! The Gaussian error linear unit.

use crate::{Backward, Op, Pool, Shape, ShapeError, Shapes, Var, View, ViewMut, ensure_shape};
use weaver_kernels::Real;
use weaver_kernels::gelu::{gelu_backward, gelu_forward};

#[derive(Debug)]
struct Gelu;

impl<T: Real> Op<T> for Gelu {
    fn name(&self) -> &'static str {
        "gelu"
    }
    fn shapes(&self, ins: &[Shape]) -> Result<Shapes, ShapeError> {
        ensure_shape!(ins.len() == 1, "one tensor");
        Ok(Shapes::one(ins[0]))
    }
    fn forward(&mut self, ins: &[View<'_, T>], outs: &mut [ViewMut<'_, T>], _pool: &Pool) {
        gelu_forward(&ins[0], &mut outs[0]);
    }
    fn backward(&self, at: Backward<'_, '_, T>) {
        let Backward { ins, douts, dins, .. } = at;
        if let Some(dx) = &mut dins[0] {
            gelu_backward(&ins[0], &douts[0], dx.target());
        }
    }
}

impl<'t, T: Real> Var<'t, T> {
    /// The Gaussian error linear unit in its exact form, x (1 + erf(x / sqrt 2)) / 2, elementwise (Hendrycks and
    /// Gimpel, arXiv 1606.08415).
    ///
    /// The result has the shape of the input. Differentiable.
    ///
    /// ```
    /// use weaver_autograd::Tape;
    /// let tape = Tape::<f64>::new();
    /// assert_eq!(tape.constant(&[0.0, 100.0], [2]).gelu().to_vec(), [0.0, 100.0]);
    /// ```
    pub fn gelu(self) -> Self {
        let [y] = self.tape().apply(Gelu, &[self]);
        y
    }
}
