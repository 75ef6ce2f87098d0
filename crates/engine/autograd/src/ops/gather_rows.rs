//! Selection of rows by index.

use crate::{Backward, Buffer, Op, Pool, Shape, ShapeError, Shapes, Var, View, ViewMut, ensure_shape};
use weaver_kernels::{Real, rows};

#[derive(Debug)]
struct GatherRows {
    indices: Buffer<u32>,
}

impl<T: Real> Op<T> for GatherRows {
    fn name(&self) -> &'static str {
        "gather_rows"
    }
    fn shapes(&self, ins: &[Shape]) -> Result<Shapes, ShapeError> {
        ensure_shape!(ins.len() == 1 && ins[0].rank() > 0, "x [N, ..]");
        if let Some(last) = self.indices.iter().max() {
            ensure_shape!((*last as usize) < ins[0][0], "x [N, ..] with row {last}");
        }
        Ok(Shapes::one(ins[0].with_axis(0, self.indices.len())))
    }
    fn forward(&mut self, ins: &[View<'_, T>], outs: &mut [ViewMut<'_, T>], _pool: &Pool) {
        let width = outs[0].shape().without_axis(0).len();
        rows::gather_rows(width, &ins[0], &self.indices, (&mut outs[0], T::ZERO));
    }
    fn backward(&self, at: Backward<'_, '_, T>) {
        let Backward { douts, dins, .. } = at;
        if let Some(dx) = &mut dins[0] {
            let width = douts[0].shape().without_axis(0).len();
            rows::scatter_add_rows(width, &douts[0], &self.indices, dx.target());
        }
    }
}

impl<'t, T: Real> Var<'t, T> {
    /// Selects rows by index: row i of the result is row `indices[i]` of x.
    ///
    /// x `[N, ..]` gives `[indices.len(), ..]`. Rows may repeat; their gradients are then added in order.
    /// Differentiable; the indices are constant. Panics if an index is not below N.
    ///
    /// ```
    /// use weaver_autograd::Tape;
    /// let tape = Tape::<f32>::new();
    /// let x = tape.constant(&[1.0, 2.0, 3.0, 4.0], [2, 2]);
    /// assert_eq!(x.gather_rows(&[1, 1, 0]).to_vec(), [3.0, 4.0, 3.0, 4.0, 1.0, 2.0]);
    /// ```
    #[track_caller]
    pub fn gather_rows(self, indices: &[u32]) -> Self {
        let indices = self.tape().pool().copy_of(indices);
        let [y] = self.tape().apply(GatherRows { indices }, &[self]);
        y
    }
}
