//! Small functions of a few numbers, applied to every row of a tensor.

use std::fmt::Debug;
use weaver_autograd::{
    Backward, Dual, MAX_RANK, Op, Pool, Real, Shape, ShapeError, Shapes, View, ViewMut, ensure_shape,
};

/// A function from `N` numbers to `M`, written once in dual numbers, so that value and derivative agree by
/// construction.
///
/// Meant for few rows, such as cameras: the derivative of a row costs about `N` times its value.
pub(crate) trait RowMap<const N: usize, const M: usize>: Debug + Send + Sync + 'static {
    /// The op's name.
    const NAME: &'static str;
    /// The trailing dimensions of each input; together they hold the `N` numbers, in order.
    const INPUTS: &'static [&'static [usize]];
    /// The trailing dimensions of each output; together they hold the `M` numbers, in order.
    const OUTPUTS: &'static [&'static [usize]];

    /// The function.
    fn eval<T: Real>(&self, row: [Dual<T, N>; N]) -> [Dual<T, N>; M];
}

/// The op that applies a [`RowMap`]; all inputs have the same leading dimensions, which the outputs share.
#[derive(Debug)]
pub(crate) struct RowMapOp<F, const N: usize, const M: usize>(pub F);

fn size(dims: &[usize]) -> usize {
    dims.iter().product()
}

/// The shape with dimensions `leading`, then `last`.
pub(crate) fn joined(leading: &[usize], last: &[usize]) -> Shape {
    let rank = leading.len() + last.len();
    assert!(rank <= MAX_RANK, "{leading:?} and {last:?} together are too many dimensions");
    let mut dims = [0; MAX_RANK];
    dims[..leading.len()].copy_from_slice(leading);
    dims[leading.len()..rank].copy_from_slice(last);
    Shape::new(&dims[..rank])
}

impl<F: RowMap<N, M>, const N: usize, const M: usize> RowMapOp<F, N, M> {
    fn row<T: Real>(ins: &[View<'_, T>], row: usize) -> [T; N] {
        let mut values = [T::ZERO; N];
        let mut at = 0;
        for (x, dims) in ins.iter().zip(F::INPUTS) {
            let n = size(dims);
            values[at..at + n].copy_from_slice(&x[row * n..(row + 1) * n]);
            at += n;
        }
        values
    }
}

impl<T: Real, F: RowMap<N, M>, const N: usize, const M: usize> Op<T> for RowMapOp<F, N, M> {
    fn name(&self) -> &'static str {
        F::NAME
    }

    fn shapes(&self, ins: &[Shape]) -> Result<Shapes, ShapeError> {
        ensure_shape!(ins.len() == F::INPUTS.len(), "{} inputs", F::INPUTS.len());
        let leading = |shape: &Shape, dims: &[usize]| {
            let at = shape.rank().checked_sub(dims.len())?;
            (&shape.dims()[at..] == dims).then(|| Shape::new(&shape.dims()[..at]))
        };
        let first = leading(&ins[0], F::INPUTS[0]);
        ensure_shape!(
            first.is_some() && ins.iter().zip(F::INPUTS).all(|(shape, dims)| leading(shape, dims) == first),
            "inputs that end in {:?} after equal leading dimensions",
            F::INPUTS
        );
        let mut shapes = Shapes::default();
        for dims in F::OUTPUTS {
            shapes = shapes.and(joined(first.expect("checked above").dims(), dims));
        }
        Ok(shapes)
    }

    fn forward(&mut self, ins: &[View<'_, T>], outs: &mut [ViewMut<'_, T>], _pool: &Pool) {
        for row in 0..ins[0].len() / size(F::INPUTS[0]) {
            let y = self.0.eval(Self::row(ins, row).map(Dual::constant));
            let mut at = 0;
            for (out, dims) in outs.iter_mut().zip(F::OUTPUTS) {
                let n = size(dims);
                for (o, y) in out[row * n..(row + 1) * n].iter_mut().zip(&y[at..]) {
                    *o = y.value;
                }
                at += n;
            }
        }
    }

    fn backward(&self, at: Backward<'_, '_, T>) {
        let Backward { ins, douts, dins, .. } = at;
        for din in dins.iter_mut().flatten() {
            din.accumulator();
        }
        for row in 0..ins[0].len() / size(F::INPUTS[0]) {
            let y = self.0.eval(Dual::inputs(Self::row(ins, row)));
            let mut gradient = [T::ZERO; N];
            let mut at = 0;
            for (dout, dims) in douts.iter().zip(F::OUTPUTS) {
                let n = size(dims);
                for (d, y) in dout[row * n..(row + 1) * n].iter().zip(&y[at..]) {
                    gradient.iter_mut().zip(&y.partial).for_each(|(g, p)| *g += *d * *p);
                }
                at += n;
            }
            let mut at = 0;
            for (din, dims) in dins.iter_mut().zip(F::INPUTS) {
                let n = size(dims);
                if let Some(din) = din {
                    let target = &mut din.accumulator()[row * n..(row + 1) * n];
                    target.iter_mut().zip(&gradient[at..]).for_each(|(t, g)| *t += *g);
                }
                at += n;
            }
        }
    }
}
