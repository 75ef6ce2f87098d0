//! Quantiles with linear interpolation, on the tape.

use weaver_autograd::{Backward, Buffer, Op, Pool, Real, Shape, ShapeError, Shapes, Var, View, ViewMut, ensure_shape};
use weaver_kernels::order::{QuantileNeighbors, ascending};

#[derive(Debug)]
struct Quantiles {
    q: Buffer<f64>,
    found: Option<Buffer<QuantileNeighbors<u32>>>,
}

impl<T: Real> Op<T> for Quantiles {
    fn name(&self) -> &'static str {
        "quantiles"
    }
    fn shapes(&self, ins: &[Shape]) -> Result<Shapes, ShapeError> {
        ensure_shape!(ins.len() == 1 && !ins[0].is_empty(), "x of at least one number");
        Ok(Shapes::one([self.q.len()]))
    }
    fn forward(&mut self, ins: &[View<'_, T>], outs: &mut [ViewMut<'_, T>], pool: &Pool) {
        let x = ins[0].data();
        let mut ranked = pool.buffer::<u32>(x.len());
        ranked.iter_mut().zip(0..).for_each(|(index, i)| *index = i);
        let mut found = pool.buffer::<QuantileNeighbors<u32>>(self.q.len());
        for ((y, found), q) in outs[0].iter_mut().zip(found.iter_mut()).zip(self.q.iter()) {
            // Equal numbers in reading order, so that the choice among them is fixed.
            let compare = |a: &u32, b: &u32| ascending(&x[*a as usize], &x[*b as usize]).then(a.cmp(b));
            *found = QuantileNeighbors::of(&mut ranked, *q, compare);
            *y = found.between(x[found.lower as usize], x[found.upper as usize]);
        }
        self.found = Some(found);
    }
    fn backward(&self, at: Backward<'_, '_, T>) {
        let Backward { douts, dins, .. } = at;
        let Some(dx) = &mut dins[0] else { return };
        let dx = dx.accumulator();
        let found = self.found.as_ref().expect("the forward pass came first");
        for (dy, found) in douts[0].iter().zip(found.iter()) {
            dx[found.lower as usize] += *dy * T::from_f64(1.0 - found.fraction);
            dx[found.upper as usize] += *dy * T::from_f64(found.fraction);
        }
    }
}

/// The quantiles of all n numbers of a tensor, on the tape.
///
/// y_i = x_(k) + (x_(k + 1) - x_(k)) f, where k + f = `q[i]` (n - 1) with integer k, and x_(k) is number k, from 0, of
/// the sorted sequence.
///
/// `x` of any shape with n > 0 numbers gives `[Q]` for Q numbers `q` from 0 to 1. Differentiable in `x`: the two
/// neighbors of each position get the gradient, and the order is held constant. Of equal numbers the earlier counts as
/// the smaller.
/// [`quantile`](weaver_kernels::order::quantile) computes single quantiles without a tape.
///
/// ```
/// use weaver_autograd::Tape;
/// let tape = Tape::<f64>::new();
/// let x = tape.leaf(&[4.0, 1.0, 2.0], [3]);
/// let y = weaver_losses::quantiles(x, &[0.75]);
/// y.sum().backward();
/// assert_eq!((y.item(), x.grad().unwrap()), (3.0, vec![0.5, 0.0, 0.5]));
/// ```
#[track_caller]
pub fn quantiles<'t, T: Real>(x: Var<'t, T>, q: &[f64]) -> Var<'t, T> {
    let q = x.tape().pool().copy_of(q);
    let [y] = x.tape().apply(Quantiles { q, found: None }, &[x]);
    y
}
