//! Binary cross entropy of probabilities.

use crate::{Backward, Op, Pool, Shape, ShapeError, Shapes, Var, View, ViewMut, ensure_shape};
use weaver_kernels::Real;

/// The logarithm of a probability is at least this, as in PyTorch.
const LEAST_LOG: f64 = -100.0;
/// p (1 - p) is at least this in the gradient, as in PyTorch.
const LEAST_VARIANCE: f64 = 1e-12;

#[derive(Debug)]
struct BinaryCrossEntropy;

impl<T: Real> Op<T> for BinaryCrossEntropy {
    fn name(&self) -> &'static str {
        "binary_cross_entropy"
    }
    fn shapes(&self, ins: &[Shape]) -> Result<Shapes, ShapeError> {
        ensure_shape!(ins.len() == 2 && ins[0] == ins[1], "p and y of one shape");
        Ok(Shapes::one(Shape::SCALAR))
    }
    fn forward(&mut self, ins: &[View<'_, T>], outs: &mut [ViewMut<'_, T>], _pool: &Pool) {
        // NaN stays what it is.
        let log = |x: f64| if x.ln() < LEAST_LOG { LEAST_LOG } else { x.ln() };
        let term = |(p, y): (&T, &T)| {
            let (p, y) = (p.to_f64(), y.to_f64());
            y * log(p) + (1.0 - y) * log(1.0 - p)
        };
        let sum: f64 = ins[0].iter().zip(ins[1].iter()).map(term).sum();
        outs[0][0] = T::from_f64(-sum / ins[0].len().max(1) as f64);
    }
    fn backward(&self, at: Backward<'_, '_, T>) {
        let Backward { ins, douts, dins, .. } = at;
        let Some(dp) = &mut dins[0] else { return };
        let (p, y) = (&ins[0], &ins[1]);
        let scale = douts[0][0] / T::from_usize(p.len().max(1));
        let least = T::from_f64(LEAST_VARIANCE);
        dp.add_each(|i| scale * (p[i] - y[i]) / (p[i] * (T::ONE - p[i])).max(least));
    }
    fn differentiable(&self, index: usize) -> bool {
        index == 0
    }
}

/// The mean binary cross entropy of probabilities p against targets y: `-mean of y ln p + (1 - y) ln(1 - p)`.
///
/// p and y have one shape, with values in [0, 1]; the result is a scalar, 0 if they are empty. Differentiable in p; y
/// is constant. Logarithms are at least -100 and p (1 - p) in the gradient at least 1e-12, as in PyTorch.
///
/// ```
/// use weaver_autograd::{Tape, ops};
/// let tape = Tape::<f64>::new();
/// let (p, y) = (tape.constant(&[0.5, 0.5], [2]), tape.constant(&[1.0, 0.0], [2]));
/// assert!((ops::binary_cross_entropy(p, y).item() - 2_f64.ln()).abs() < 1e-15);
/// ```
#[track_caller]
pub fn binary_cross_entropy<'t, T: Real>(p: Var<'t, T>, y: Var<'t, T>) -> Var<'t, T> {
    let [loss] = p.tape().apply(BinaryCrossEntropy, &[p, y]);
    loss
}
