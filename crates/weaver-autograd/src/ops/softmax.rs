//! Softmax and its logarithm along an axis.

use super::blocks::around;
use crate::{Grad, Op, Pool, Shape, ShapeError, Shapes, Var, View, ViewMut, ensure_shape};
use weaver_kernels::{Real, parallel};

#[derive(Debug)]
struct Softmax {
    axis: usize,
    log: bool,
}

/// Indices of the `len` elements of lane `lane` of a block `[len, inner]`.
fn lane(lane: usize, [_, len, inner]: [usize; 3]) -> impl Iterator<Item = usize> + Clone {
    (0..len).map(move |i| i * inner + lane)
}

impl<T: Real> Op<T> for Softmax {
    fn name(&self) -> &'static str {
        if self.log { "log_softmax" } else { "softmax" }
    }
    fn shapes(&self, ins: &[Shape]) -> Result<Shapes, ShapeError> {
        ensure_shape!(ins.len() == 1 && self.axis < ins[0].rank(), "a tensor with an axis {}", self.axis);
        Ok(Shapes::one(ins[0]))
    }
    fn forward(&mut self, ins: &[View<'_, T>], outs: &mut [ViewMut<'_, T>], _pool: &Pool) {
        let sizes = around(ins[0].shape(), self.axis);
        let size = sizes[1] * sizes[2];
        let x = &ins[0];
        parallel::for_chunks(&mut outs[0], size, |o, y| {
            let x = &x[o * size..][..size];
            for l in 0..sizes[2] {
                let of_lane = lane(l, sizes);
                let max = of_lane.clone().map(|i| x[i]).fold(-T::INFINITY, |a, b| a.max(b));
                let mut sum = T::ZERO;
                for i in of_lane.clone() {
                    y[i] = (x[i] - max).exp();
                    sum += y[i];
                }
                if self.log {
                    let shift = max + sum.ln();
                    of_lane.for_each(|i| y[i] = x[i] - shift);
                } else {
                    of_lane.for_each(|i| y[i] /= sum);
                }
            }
        });
    }
    fn backward(
        &self,
        _ins: &[View<'_, T>],
        outs: &[View<'_, T>],
        douts: &[View<'_, T>],
        dins: &mut [Option<Grad<'_, T>>],
        _pool: &Pool,
    ) {
        let Some(dx) = &mut dins[0] else { return };
        let sizes = around(outs[0].shape(), self.axis);
        let size = sizes[1] * sizes[2];
        let (dx, beta) = dx.target();
        parallel::for_chunks(dx, size, |o, dx| {
            let (y, dy) = (&outs[0][o * size..][..size], &douts[0][o * size..][..size]);
            for l in 0..sizes[2] {
                let of_lane = lane(l, sizes);
                let sum: T = of_lane.clone().map(|i| if self.log { dy[i] } else { dy[i] * y[i] }).sum();
                for i in of_lane {
                    let g = if self.log { dy[i] - y[i].exp() * sum } else { y[i] * (dy[i] - sum) };
                    dx[i] = if beta == T::ZERO { g } else { dx[i] + g };
                }
            }
        });
    }
}

impl<'t, T: Real> Var<'t, T> {
    /// e^x over its sum along an axis; the largest x is subtracted first, so nothing overflows.
    #[track_caller]
    pub fn softmax(self, axis: usize) -> Self {
        let [y] = self.tape().apply(Softmax { axis, log: false }, &[self]);
        y
    }

    /// The logarithm of [`softmax`](Var::softmax), accurate where that underflows: x - ln(sum of e^x).
    #[track_caller]
    pub fn log_softmax(self, axis: usize) -> Self {
        let [y] = self.tape().apply(Softmax { axis, log: true }, &[self]);
        y
    }
}
