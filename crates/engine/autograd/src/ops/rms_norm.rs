//! Root-mean-square normalization over the last axis.

use crate::{Backward, Grad, Op, Pool, Shape, ShapeError, Shapes, Var, View, ViewMut, ensure_shape};
use weaver_kernels::{Real, rms_norm};

#[derive(Debug)]
struct RmsNorm {
    eps: f64,
}

impl<T: Real> Op<T> for RmsNorm {
    fn name(&self) -> &'static str {
        "rms_norm"
    }
    fn shapes(&self, ins: &[Shape]) -> Result<Shapes, ShapeError> {
        ensure_shape!(
            ins.len() == 2 && ins[0].rank() > 0 && ins[1] == Shape::from([ins[0].last()]),
            "x [.., D], w [D]"
        );
        Ok(Shapes::one(ins[0]))
    }
    fn forward(&mut self, ins: &[View<'_, T>], outs: &mut [ViewMut<'_, T>], _pool: &Pool) {
        rms_norm::rms_norm_forward(T::from_f64(self.eps), &ins[0], &ins[1], &mut outs[0]);
    }
    fn backward(&self, at: Backward<'_, '_, T>) {
        let Backward { ins, douts, dins, pool, .. } = at;
        let (x, w) = (&ins[0], &ins[1]);
        let mut scratch = pool.buffer(rms_norm::rms_norm_scratch_len(x.shape().rows(), w.len()));
        let mut targets = dins.iter_mut().map(|grad| grad.as_mut().map(Grad::target));
        let targets = [(); 2].map(|()| targets.next().flatten());
        rms_norm::rms_norm_backward(T::from_f64(self.eps), x, w, &douts[0], targets, &mut scratch);
    }
}

impl<'t, T: Real> Var<'t, T> {
    /// Root-mean-square normalization over the last axis: y = x / sqrt(mean(x^2) + eps) * w (Zhang and Sennrich, arXiv
    /// 1910.07467).
    ///
    /// x is `[.., D]`, w is `[D]`; the result has the shape of x. Differentiable in both; eps is constant.
    ///
    /// ```
    /// use weaver_autograd::Tape;
    /// let tape = Tape::<f64>::new();
    /// let (x, w) = (tape.constant(&[2.0, -2.0], [1, 2]), tape.constant(&[1.0, 3.0], [2]));
    /// assert_eq!(x.rms_norm(w, 0.0).to_vec(), [1.0, -3.0]);
    /// ```
    #[track_caller]
    pub fn rms_norm(self, w: Self, eps: f64) -> Self {
        let [y] = self.tape().apply(RmsNorm { eps }, &[self, w]);
        y
    }
}
