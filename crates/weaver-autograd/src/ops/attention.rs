//! Scaled dot-product attention.

use crate::{Buffer, Grad, Op, Pool, Shape, ShapeError, Shapes, Var, View, ViewMut, ensure_shape};
use weaver_kernels::{
    Real,
    attention::{self, Strides},
};

#[derive(Debug)]
struct Attention<T: Real> {
    scale: f64,
    /// Per query the binary logarithm of its sum of exponentials.
    log_sums: Option<Buffer<T>>,
}

fn sizes(q: Shape, k: Shape) -> (attention::Attention, Strides, Strides) {
    let size = attention::Attention { batch: q[0], heads: q[2], queries: q[1], keys: k[1], dim: q[3] };
    (size, Strides::tokens_first(q[1], q[2], q[3]), Strides::tokens_first(k[1], q[2], q[3]))
}

impl<T: Real> Op<T> for Attention<T> {
    fn name(&self) -> &'static str {
        "attention"
    }
    fn shapes(&self, ins: &[Shape]) -> Result<Shapes, ShapeError> {
        let fits = ins.len() == 3 && ins.iter().all(|s| s.rank() == 4);
        ensure_shape!(
            fits && ins[1] == ins[2] && ins[0].with_axis(1, ins[1][1]) == ins[1],
            "q [B, Nq, H, D], k and v [B, Nk, H, D]"
        );
        Ok(Shapes::one(ins[0]))
    }
    fn forward(&mut self, ins: &[View<'_, T>], outs: &mut [ViewMut<'_, T>], pool: &Pool) {
        let (size, of_q, of_k) = sizes(ins[0].shape(), ins[1].shape());
        let mut log_sums = pool.buffer(size.batch * size.heads * size.queries);
        let (q, k, v, y) = (&*ins[0], &*ins[1], &*ins[2], &mut *outs[0]);
        let scale = T::from_f64(self.scale);
        attention::attention_forward(&size, scale, (q, of_q), (k, of_k), (v, of_k), (y, of_q), &mut log_sums);
        self.log_sums = Some(log_sums);
    }
    fn backward(
        &self,
        ins: &[View<'_, T>],
        outs: &[View<'_, T>],
        douts: &[View<'_, T>],
        dins: &mut [Option<Grad<'_, T>>],
        _pool: &Pool,
    ) {
        let (size, of_q, of_k) = sizes(ins[0].shape(), ins[1].shape());
        let log_sums = self.log_sums.as_ref().expect("the forward pass came first");
        let [dq, dk, dv] = dins else { unreachable!("attention has three inputs") };
        attention::attention_backward(
            &size,
            T::from_f64(self.scale),
            (&ins[0], of_q),
            (&ins[1], of_k),
            (&ins[2], of_k),
            (&outs[0], of_q),
            log_sums,
            &douts[0],
            dq.as_mut().map(|d| (d.target(), of_q)),
            dk.as_mut().map(|d| (d.target(), of_k)),
            dv.as_mut().map(|d| (d.target(), of_k)),
        );
    }
}

/// Scaled dot-product attention, softmax(scale q k^T) v for every batch entry and head (Vaswani et al., arXiv
/// 1706.03762); the matrix of scores is never stored (Dao et al., arXiv 2205.14135).
///
/// q `[B, Nq, H, D]`, k and v `[B, Nk, H, D]`; the result is `[B, Nq, H, D]`, 0 without keys. `scale` is usually
/// `1 / sqrt(D)`. Differentiable in q, k and v.
///
/// ```
/// use weaver_autograd::{Tape, ops};
/// let tape = Tape::<f64>::new();
/// let q = tape.constant(&[0.0], [1, 1, 1, 1]);
/// let (k, v) = (tape.constant(&[5.0, 6.0], [1, 2, 1, 1]), tape.constant(&[1.0, 3.0], [1, 2, 1, 1]));
/// assert_eq!(ops::attention(q, k, v, 1.0).item(), 2.0);
/// ```
#[track_caller]
pub fn attention<'t, T: Real>(q: Var<'t, T>, k: Var<'t, T>, v: Var<'t, T>, scale: f64) -> Var<'t, T> {
    let [y] = q.tape().apply(Attention { scale, log_sums: None }, &[q, k, v]);
    y
}
