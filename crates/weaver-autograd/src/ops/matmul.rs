//! Matrix products, batched or with one right-hand side for all.

use crate::{Grad, Op, Pool, Shape, ShapeError, Shapes, Var, View, ViewMut, ensure_shape};
use weaver_kernels::{Real, gemm::gemm_batched};

#[derive(Debug)]
struct Matmul {
    trans_a: bool,
    trans_b: bool,
}

/// The sizes of a product: `batch` products of [m, k] by [k, n], in which B may be shared.
#[derive(Clone, Copy)]
struct Sizes {
    batch: usize,
    m: usize,
    n: usize,
    k: usize,
    shared: bool,
}

impl Matmul {
    /// Rows and columns of the last two axes after transposition.
    fn matrix(shape: Shape, trans: bool) -> (usize, usize) {
        let (rows, cols) = (shape[shape.rank() - 2], shape[shape.rank() - 1]);
        if trans { (cols, rows) } else { (rows, cols) }
    }

    fn sizes(&self, a: Shape, b: Shape) -> Sizes {
        let ((m, k), (_, n)) = (Self::matrix(a, self.trans_a), Self::matrix(b, self.trans_b));
        let batch = a.dims()[..a.rank() - 2].iter().product();
        let shared = b.rank() == 2;
        // Rows of all batch entries against one B are a single product.
        if shared && !self.trans_a {
            Sizes { batch: 1, m: batch * m, n, k, shared }
        } else {
            Sizes { batch, m, n, k, shared }
        }
    }
}

impl<T: Real> Op<T> for Matmul {
    fn name(&self) -> &'static str {
        "matmul"
    }
    fn shapes(&self, ins: &[Shape]) -> Result<Shapes, ShapeError> {
        ensure_shape!(ins.len() == 2 && ins[0].rank() >= 2 && ins[1].rank() >= 2, "two tensors of rank 2 or more");
        let (a, b) = (ins[0], ins[1]);
        let lead = |s: Shape| s.with_axis(s.rank() - 1, 0).with_axis(s.rank() - 2, 0);
        ensure_shape!(b.rank() == 2 || lead(a) == lead(b), "equal leading dimensions, or a second tensor of rank 2");
        let ((m, k), (rows, n)) = (Self::matrix(a, self.trans_a), Self::matrix(b, self.trans_b));
        ensure_shape!(k == rows, "equal inner dimensions, not {k} and {rows}");
        Ok(Shapes::one(a.with_axis(a.rank() - 2, m).with_last(n)))
    }
    fn forward(&mut self, ins: &[View<'_, T>], outs: &mut [ViewMut<'_, T>], _pool: &Pool) {
        let Sizes { batch, m, n, k, shared } = self.sizes(ins[0].shape(), ins[1].shape());
        let b_step = if shared { 0 } else { k * n };
        let (a, b, y) = (&ins[0], &ins[1], &mut outs[0]);
        gemm_batched(batch, self.trans_a, self.trans_b, m, n, k, T::ONE, a, m * k, b, b_step, T::ZERO, y, m * n);
    }
    fn backward(
        &self,
        ins: &[View<'_, T>],
        _outs: &[View<'_, T>],
        douts: &[View<'_, T>],
        dins: &mut [Option<Grad<'_, T>>],
        _pool: &Pool,
    ) {
        let Sizes { batch, m, n, k, shared } = self.sizes(ins[0].shape(), ins[1].shape());
        let Self { trans_a, trans_b } = *self;
        let (mk, kn, mn) = (m * k, k * n, m * n);
        let b_step = if shared { 0 } else { kn };
        let (a, b, dy) = (&ins[0], &ins[1], &douts[0]);
        if let Some(da) = &mut dins[0] {
            let (da, beta) = da.target();
            if trans_a {
                gemm_batched(batch, trans_b, true, k, m, n, T::ONE, b, b_step, dy, mn, beta, da, mk);
            } else {
                gemm_batched(batch, false, !trans_b, m, k, n, T::ONE, dy, mn, b, b_step, beta, da, mk);
            }
        }
        let Some(db) = &mut dins[1] else { return };
        if batch == 0 {
            db.add_zero();
            return;
        }
        // A shared B collects from the batch entries one after the other.
        let (rounds, batch) = if shared { (batch, 1) } else { (1, batch) };
        for round in 0..rounds {
            let (a, dy) = (&a[round * mk..], &dy[round * mn..]);
            let (db, beta) = db.target();
            if trans_b {
                gemm_batched(batch, true, trans_a, n, k, m, T::ONE, dy, mn, a, mk, beta, db, kn);
            } else {
                gemm_batched(batch, !trans_a, false, k, n, m, T::ONE, a, mk, dy, mn, beta, db, kn);
            }
        }
    }
}

impl<'t, T: Real> Var<'t, T> {
    /// The matrix product: `[.., m, k]` times `[.., k, n]` gives `[.., m, n]`. Leading dimensions agree, or the second
    /// tensor has rank 2 and serves for all. Differentiable in both.
    ///
    /// ```
    /// use weaver_autograd::Tape;
    /// let tape = Tape::<f32>::new();
    /// let (a, b) = (tape.constant(&[1.0, 2.0, 3.0, 4.0], [2, 2]), tape.constant(&[5.0, 6.0], [2, 1]));
    /// assert_eq!(a.matmul(b).to_vec(), [17.0, 39.0]);
    /// ```
    #[track_caller]
    pub fn matmul(self, b: Self) -> Self {
        self.matmul_with(b, false, false)
    }

    /// [`matmul`](Var::matmul) of operands whose last two axes are exchanged first where the flag says so: a transposed
    /// A is stored as `[.., k, m]`, a transposed B as `[.., n, k]`. Nothing is copied. Differentiable in both.
    ///
    /// ```
    /// use weaver_autograd::Tape;
    /// let tape = Tape::<f32>::new();
    /// let (a, b) = (tape.constant(&[1.0, 2.0], [1, 2]), tape.constant(&[5.0, 6.0], [1, 2]));
    /// assert_eq!(a.matmul_with(b, false, true).to_vec(), [17.0]);
    /// ```
    #[track_caller]
    pub fn matmul_with(self, b: Self, trans_a: bool, trans_b: bool) -> Self {
        let [y] = self.tape().apply(Matmul { trans_a, trans_b }, &[self, b]);
        y
    }
}
