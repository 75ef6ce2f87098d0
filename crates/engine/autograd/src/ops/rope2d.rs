//! Rotary position embedding in two dimensions.

use crate::{Backward, Op, Pool, Shape, ShapeError, Shapes, Var, View, ViewMut, ensure_shape};
use std::sync::Arc;
use weaver_kernels::{Real, rope::Rope2d};

/// The rotations of tokens at given positions, for [`Var::rope2d`]. Clones share the table.
#[derive(Clone, Debug)]
pub struct RopeTable<T: Real = f32> {
    rope: Arc<Rope2d<T>>,
    dim: usize,
}

impl<T: Real> RopeTable<T> {
    /// Tabulates the rotations of tokens at `positions`, (row, column) each, for heads of length `dim`; `base` is
    /// usually 100.
    ///
    /// # Panics
    ///
    /// If `dim` is not divisible by 4.
    pub fn new(positions: &[[usize; 2]], dim: usize, base: f64) -> Self {
        Self { rope: Arc::new(Rope2d::new(positions, dim, base)), dim }
    }

    /// The rotations the other way: `x.rope2d(&table).rope2d(&table.inverse())` is x.
    ///
    /// ```
    /// use weaver_autograd::{Tape, ops::RopeTable};
    /// let (tape, table) = (Tape::<f64>::new(), RopeTable::new(&[[1, 0]], 4, 100.0));
    /// let y = tape.constant(&[1.0, 0.0, 0.0, 0.0], [1, 1, 1, 4]).rope2d(&table.inverse()).to_vec();
    /// assert_eq!(y, [1_f64.cos(), -1_f64.sin(), 0.0, 0.0]);
    /// ```
    #[must_use]
    pub fn inverse(&self) -> Self {
        Self { rope: Arc::new(self.rope.inverse()), dim: self.dim }
    }

    /// Number of tokens.
    pub fn tokens(&self) -> usize {
        self.rope.tokens()
    }
}

#[derive(Debug)]
struct Rope<T: Real> {
    table: RopeTable<T>,
}

impl<T: Real> Op<T> for Rope<T> {
    fn name(&self) -> &'static str {
        "rope2d"
    }
    fn shapes(&self, ins: &[Shape]) -> Result<Shapes, ShapeError> {
        let (tokens, dim) = (self.table.tokens(), self.table.dim);
        ensure_shape!(
            ins.len() == 1 && ins[0].rank() == 4 && ins[0][1] == tokens && ins[0][3] == dim,
            "x [B, {tokens}, H, {dim}]"
        );
        Ok(Shapes::one(ins[0]))
    }
    fn forward(&mut self, ins: &[View<'_, T>], outs: &mut [ViewMut<'_, T>], _pool: &Pool) {
        self.table.rope.forward(ins[0].shape()[2], &ins[0], &mut outs[0]);
    }
    fn backward(&self, at: Backward<'_, '_, T>) {
        let Backward { ins, douts, dins, .. } = at;
        if let Some(dx) = &mut dins[0] {
            self.table.rope.backward(ins[0].shape()[2], &douts[0], dx.target());
        }
    }
}

impl<'t, T: Real> Var<'t, T> {
    /// Rotary position embedding in two dimensions (Su et al., arXiv 2104.09864; Heo et al., arXiv 2403.13298).
    ///
    /// x is `[B, N, H, D]`, with the same positions for every batch entry. The first half of a head is rotated by the
    /// row of the token, the second by its column: in a half of length n, elements k and k + n/2 are rotated by the
    /// angle position * base^(-2 k / n). A token at (0, 0) is unchanged. Differentiable; the table is constant.
    ///
    /// ```
    /// use weaver_autograd::{Tape, ops::RopeTable};
    /// let (tape, table) = (Tape::<f64>::new(), RopeTable::new(&[[0, 0], [1, 0]], 4, 100.0));
    /// let y = tape.constant(&[1.0, 0.0, 1.0, 0.0, 1.0, 0.0, 1.0, 0.0], [1, 2, 1, 4]).rope2d(&table).to_vec();
    /// assert_eq!(y[..4], [1.0, 0.0, 1.0, 0.0]);
    /// assert_eq!(y[4..], [1_f64.cos(), 1_f64.sin(), 1.0, 0.0]);
    /// ```
    #[track_caller]
    pub fn rope2d(self, table: &RopeTable<T>) -> Self {
        let [y] = self.tape().apply(Rope { table: table.clone() }, &[self]);
        y
    }
}
