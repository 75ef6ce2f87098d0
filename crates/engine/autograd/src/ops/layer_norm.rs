//! Layer normalization over the last axis.

use crate::{Backward, Buffer, Grad, Op, Pool, Shape, ShapeError, Shapes, Var, View, ViewMut, ensure_shape};
use weaver_kernels::{Real, layer_norm};

#[derive(Debug)]
struct LayerNorm<T: Real> {
    eps: f64,
    /// The mean and the inverse standard deviation of every row.
    statistics: Option<Buffer<T>>,
}

impl<T: Real> Op<T> for LayerNorm<T> {
    fn name(&self) -> &'static str {
        "layer_norm"
    }
    fn shapes(&self, ins: &[Shape]) -> Result<Shapes, ShapeError> {
        let width = Shape::from([ins[0].last()]);
        ensure_shape!(ins[0].rank() > 0 && ins[1..].iter().all(|s| *s == width), "x [.., D], w [D], b [D]");
        Ok(Shapes::one(ins[0]))
    }
    fn forward(&mut self, ins: &[View<'_, T>], outs: &mut [ViewMut<'_, T>], pool: &Pool) {
        let width = ins[0].shape().last();
        let mut statistics = pool.buffer(2 * ins[0].shape().rows());
        let affine = ins.get(1).zip(ins.get(2)).map(|(w, b)| (w.data(), b.data()));
        let eps = T::from_f64(self.eps);
        layer_norm::layer_norm_forward(width, eps, &ins[0], affine, &mut outs[0], &mut statistics);
        self.statistics = Some(statistics);
    }
    fn backward(&self, at: Backward<'_, '_, T>) {
        let Backward { ins, douts, dins, pool, .. } = at;
        let (x, dy, width) = (&ins[0], &douts[0], ins[0].shape().last());
        let statistics = self.statistics.as_ref().expect("the forward pass came first");
        let mut scratch = pool.buffer(layer_norm::layer_norm_scratch_len(ins[0].shape().rows(), width));
        let mut targets = dins.iter_mut().map(|grad| grad.as_mut().map(Grad::target));
        let targets = [(); 3].map(|()| targets.next().flatten());
        let weights = ins.get(1).map(View::data);
        layer_norm::layer_norm_backward(width, x, weights, statistics, dy, targets, &mut scratch);
    }
}

impl<'t, T: Real> Var<'t, T> {
    /// Layer normalization over the last axis: y = (x - mean) / sqrt(variance + eps) * w + b, with the population
    /// variance (Ba et al., arXiv 1607.06450).
    ///
    /// x is `[.., D]`, w and b are `[D]` or left out; the result has the shape of x. Differentiable in all three; eps
    /// is constant.
    ///
    /// ```
    /// use weaver_autograd::Tape;
    /// let tape = Tape::<f64>::new();
    /// assert_eq!(tape.constant(&[1.0, 3.0], [1, 2]).layer_norm(None, 0.0).to_vec(), [-1.0, 1.0]);
    /// ```
    #[track_caller]
    pub fn layer_norm(self, affine: Option<(Self, Self)>, eps: f64) -> Self {
        let op = LayerNorm { eps, statistics: None };
        let [y] = match affine {
            Some((w, b)) => self.tape().apply(op, &[self, w, b]),
            None => self.tape().apply(op, &[self]),
        };
        y
    }
}
