//! Scaled dot-product attention.

use crate::{Backward, Buffer, Op, Pool, Shape, ShapeError, Shapes, Var, View, ViewMut, ensure_shape};
use weaver_kernels::{
    Real,
    attention::{AttentionInputs, AttentionOutput, AttentionShape, Strides, attention_backward, attention_forward},
};

#[derive(Debug)]
struct Attention<T: Real> {
    scale: f64,
    /// The binary logarithm of the sum of exponentials of every query.
    log_sums: Option<Buffer<T>>,
}

/// The layout of a tensor `[B, N, H, D]`.
fn strides(shape: Shape) -> Strides {
    Strides::tokens_first(shape[1], shape[2], shape[3])
}

impl<T: Real> Attention<T> {
    fn inputs<'a>(&self, ins: &'a [View<'_, T>]) -> AttentionInputs<'a, T> {
        let (q, k) = (ins[0].shape(), ins[1].shape());
        let shape = AttentionShape { batch: q[0], heads: q[2], queries: q[1], keys: k[1], dim: q[3] };
        let [q, k, v] = [0, 1, 2].map(|i| (&*ins[i], strides(ins[i].shape())));
        AttentionInputs { shape, scale: T::from_f64(self.scale), q, k, v }
    }
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
        let inputs = self.inputs(ins);
        let AttentionShape { batch, heads, queries, .. } = inputs.shape;
        let mut log_sums = pool.buffer(batch * heads * queries);
        attention_forward(&inputs, (&mut outs[0], inputs.q.1), &mut log_sums);
        self.log_sums = Some(log_sums);
    }
    fn backward(&self, at: Backward<'_, '_, T>) {
        let Backward { ins, outs, douts, dins, .. } = at;
        let inputs = self.inputs(ins);
        let lse = self.log_sums.as_ref().expect("the forward pass came first");
        let output = AttentionOutput { out: (&outs[0], inputs.q.1), lse };
        let [dq, dk, dv] = dins else { unreachable!("attention has three inputs") };
        let gradients = [(dq, inputs.q.1), (dk, inputs.k.1), (dv, inputs.v.1)];
        let gradients = gradients.map(|(d, strides)| d.as_mut().map(|d| (d.target(), strides)));
        attention_backward(&inputs, &output, &douts[0], gradients);
    }
}

/// Scaled dot-product attention, softmax(scale q k^T) v for every batch entry and head (Vaswani et al., arXiv
/// 1706.03762). The matrix of scores is never stored (Dao et al., arXiv 2205.14135).
///
/// q is `[B, Nq, H, D]`, k and v are `[B, Nk, H, D]`; the result is `[B, Nq, H, D]`, and 0 if there are no keys.
/// `scale` is usually `1 / sqrt(D)`. Differentiable in q, k and v.
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
