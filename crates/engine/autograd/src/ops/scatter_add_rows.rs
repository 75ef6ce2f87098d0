//! Sums of rows by index.

use crate::{Backward, Buffer, Op, Pool, Shape, ShapeError, Shapes, Var, View, ViewMut, ensure_shape};
use weaver_kernels::{Real, rows};

#[derive(Debug)]
struct ScatterAddRows {
    indices: Buffer<u32>,
    rows: usize,
}

impl<T: Real> Op<T> for ScatterAddRows {
    fn name(&self) -> &'static str {
        "scatter_add_rows"
    }
    fn shapes(&self, ins: &[Shape]) -> Result<Shapes, ShapeError> {
        let count = self.indices.len();
        ensure_shape!(
            ins.len() == 1 && ins[0].rank() > 0 && ins[0][0] == count,
            "x [{count}, ..], a row for every index"
        );
        if let Some(last) = self.indices.iter().max() {
            ensure_shape!((*last as usize) < self.rows, "indices below {}, not {last}", self.rows);
        }
        Ok(Shapes::one(ins[0].with_axis(0, self.rows)))
    }
    fn forward(&mut self, ins: &[View<'_, T>], outs: &mut [ViewMut<'_, T>], _pool: &Pool) {
        let width = outs[0].shape().without_axis(0).len();
        rows::scatter_add_rows(width, &ins[0], &self.indices, (&mut outs[0], T::ZERO));
    }
    fn backward(&self, at: Backward<'_, '_, T>) {
        let Backward { douts, dins, .. } = at;
        if let Some(dx) = &mut dins[0] {
            let width = douts[0].shape().without_axis(0).len();
            rows::gather_rows(width, &douts[0], &self.indices, dx.target());
        }
    }
}

impl<'t, T: Real> Var<'t, T> {
    /// Adds rows by index: row r of the result is the sum of all rows i of x with `indices[i] == r`, added in the order
    /// of i. The adjoint of [`gather_rows`](Var::gather_rows).
    ///
    /// x `[indices.len(), ..]` gives `[n, ..]`. Differentiable; the indices are constant. Panics if an index is not
    /// below `n`.
    ///
    /// ```
    /// use weaver_autograd::Tape;
    /// let tape = Tape::<f32>::new();
    /// let x = tape.constant(&[1.0, 2.0, 4.0], [3, 1]);
    /// assert_eq!(x.scatter_add_rows(&[1, 0, 1], 2).to_vec(), [2.0, 5.0]);
    /// ```
    #[track_caller]
    pub fn scatter_add_rows(self, indices: &[u32], n: usize) -> Self {
        let indices = self.tape().pool().copy_of(indices);
        let [y] = self.tape().apply(ScatterAddRows { indices, rows: n }, &[self]);
        y
    }
}
