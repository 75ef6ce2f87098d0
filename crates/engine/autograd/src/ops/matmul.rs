//! Matrix products, batched or with a shared right factor.

use crate::{Backward, Op, Pool, Shape, ShapeError, Shapes, Var, View, ViewMut, ensure_shape};
use weaver_kernels::Real;
use weaver_kernels::gemm::{Batch, Mat, MatMut, gemm_batched};

#[derive(Debug)]
struct Matmul {
    trans_a: bool,
    trans_b: bool,
}

/// The sizes of a product: `batch` products of [m, k] by [k, n], all with the same B if it is shared.
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
        // The rows of all batch entries with one B form a single product.
        if shared && !self.trans_a {
            Sizes { batch: 1, m: batch * m, n, k, shared }
        } else {
            Sizes { batch, m, n, k, shared }
        }
    }

    /// A and B as m x k and k x n matrices, however they are stored.
    fn operands<'a, T: Real>(&self, sizes: &Sizes, a: &'a [T], b: &'a [T]) -> [Batch<Mat<'a, T>>; 2] {
        let Sizes { m, n, k, shared, .. } = *sizes;
        let matrix = |data, rows, cols, trans| {
            if trans { Mat::new(data, cols, rows).transposed() } else { Mat::new(data, rows, cols) }
        };
        let b_stride = if shared { 0 } else { k * n };
        [matrix(a, m, k, self.trans_a).batch(m * k), matrix(b, k, n, self.trans_b).batch(b_stride)]
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
        let sizes = self.sizes(ins[0].shape(), ins[1].shape());
        let [a, b] = self.operands(&sizes, &ins[0], &ins[1]);
        let Sizes { batch, m, n, .. } = sizes;
        gemm_batched(batch, T::ONE, a, b, T::ZERO, MatMut::new(&mut outs[0], m, n).batch(m * n));
    }
    fn backward(&self, at: Backward<'_, '_, T>) {
        let Backward { ins, douts, dins, .. } = at;
        let sizes = self.sizes(ins[0].shape(), ins[1].shape());
        let Sizes { batch, m, n, k, shared } = sizes;
        let (mk, kn, mn) = (m * k, k * n, m * n);
        if let Some(da) = &mut dins[0] {
            let [_, b] = self.operands(&sizes, &ins[0], &ins[1]);
            let dy = Mat::new(&douts[0], m, n).batch(mn);
            let (da, beta) = da.target();
            if self.trans_a {
                gemm_batched(batch, T::ONE, b, dy.transposed(), beta, MatMut::new(da, k, m).batch(mk));
            } else {
                gemm_batched(batch, T::ONE, dy, b.transposed(), beta, MatMut::new(da, m, k).batch(mk));
            }
        }
        let Some(db) = &mut dins[1] else { return };
        if batch == 0 {
            db.add_zero();
            return;
        }
        // The gradient of a shared B is accumulated over the batch entries in order.
        let (rounds, batch) = if shared { (batch, 1) } else { (1, batch) };
        for round in 0..rounds {
            let [a, _] = self.operands(&sizes, &ins[0][round * mk..], &ins[1]);
            let dy = Mat::new(&douts[0][round * mn..], m, n).batch(mn);
            let (db, beta) = db.target();
            if self.trans_b {
                gemm_batched(batch, T::ONE, dy.transposed(), a, beta, MatMut::new(db, n, k).batch(kn));
            } else {
                gemm_batched(batch, T::ONE, a.transposed(), dy, beta, MatMut::new(db, k, n).batch(kn));
            }
        }
    }
}

impl<'t, T: Real> Var<'t, T> {
    /// The matrix product: `[.., m, k]` times `[.., k, n]` gives `[.., m, n]`. Leading dimensions must agree, or the
    /// second tensor has rank 2 and is used for all. Differentiable in both.
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

    /// [`matmul`](Var::matmul) with the first or second operand transposed: with `trans_a`, `self` is `[.., k, m]`;
    /// with `trans_b`, `b` is `[.., n, k]`. Nothing is copied. Differentiable in both.
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
