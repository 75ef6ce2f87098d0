//! Passes over all views, for some of the channels.

use crate::error::LiftError;
use crate::observations::Observations;
use crate::operator::Operator;
use crate::rows::Rows;
use std::ops::Range;
use weaver_kernels::{Real, parallel};

/// Gaussians, or pixels, of a parallel task.
const GRAIN: usize = 1024;

/// Inputs of passes.
pub(crate) struct Passes<'a, T: Real, O, B> {
    pub operator: &'a mut O,
    pub observations: &'a mut B,
    pub rows: &'a Rows<T>,
    /// The channels at hand.
    pub channels: Range<usize>,
    pub seen_view: &'a mut dyn FnMut(),
    /// Features of a view's pixels: drawn, and given.
    pub drawn: Vec<T>,
    pub given: Vec<T>,
}

/// `|A X - B|^2` and `|B|^2`.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Loss {
    pub loss: f64,
    pub of_zeros: f64,
}

impl<T: Real, O: Operator<T>, B: Observations<T>> Passes<'_, T, O, B> {
    /// Channels at hand.
    pub fn width(&self) -> usize {
        self.channels.len()
    }

    /// `out = A^T B`.
    pub fn gather(&mut self, out: &mut [T]) -> Result<(), LiftError> {
        out.fill(T::ZERO);
        for view in 0..self.operator.views() {
            self.read(view)?;
            self.operator.adjoint(view, &self.given, self.channels.len(), out)?;
            (self.seen_view)();
        }
        Ok(())
    }

    /// `out = (A o A)^T B`, by squared weights.
    pub fn gather_squared(&mut self, out: &mut [T]) -> Result<(), LiftError> {
        out.fill(T::ZERO);
        for view in 0..self.operator.views() {
            self.read(view)?;
            self.operator.adjoint_squared(view, &self.given, self.channels.len(), out)?;
            (self.seen_view)();
        }
        Ok(())
    }

    /// `out = A^T (B - A x)`.
    pub fn residual(&mut self, x: &[T], out: &mut [T]) -> Result<(), LiftError> {
        out.fill(T::ZERO);
        for view in 0..self.operator.views() {
            self.difference(view, x)?;
            self.operator.adjoint(view, &self.given, self.channels.len(), out)?;
            (self.seen_view)();
        }
        Ok(())
    }

    /// `out = A^T A x`.
    pub fn normal(&mut self, x: &[T], out: &mut [T]) -> Result<(), LiftError> {
        out.fill(T::ZERO);
        let width = self.channels.len();
        for view in 0..self.operator.views() {
            self.drawn.resize(self.operator.rays(view) * width, T::ZERO);
            self.operator.forward(view, x, width, &mut self.drawn)?;
            let factors = &self.rows.factors[view];
            parallel::for_chunks(&mut self.drawn, GRAIN * width, |chunk, drawn| {
                for (row, factor) in drawn.chunks_exact_mut(width).zip(&factors[chunk * GRAIN..]) {
                    if *factor == T::ZERO {
                        row.fill(T::ZERO);
                    }
                }
            });
            self.operator.adjoint(view, &self.drawn, width, out)?;
            (self.seen_view)();
        }
        Ok(())
    }

    /// Squared distance of `x` from the features of valid pixels.
    pub fn loss(&mut self, x: &[T]) -> Result<Loss, LiftError> {
        let mut loss = Loss::default();
        for view in 0..self.operator.views() {
            self.read(view)?;
            loss.of_zeros += squares(&self.given);
            self.difference(view, x)?;
            loss.loss += squares(&self.given);
            (self.seen_view)();
        }
        Ok(loss)
    }

    /// Leaves B of a view in `given`; zeros at masked pixels.
    fn read(&mut self, view: usize) -> Result<(), LiftError> {
        let width = self.channels.len();
        self.given.resize(self.operator.rays(view) * width, T::ZERO);
        self.observations.read(view, self.channels.clone(), &mut self.given)?;
        let factors = &self.rows.factors[view];
        parallel::for_chunks(&mut self.given, GRAIN * width, |chunk, given| {
            for (row, factor) in given.chunks_exact_mut(width).zip(&factors[chunk * GRAIN..]) {
                match *factor == T::ZERO {
                    // A masked pixel may hold NaN.
                    true => row.fill(T::ZERO),
                    false => row.iter_mut().for_each(|x| *x *= *factor),
                }
            }
        });
        Ok(())
    }

    /// Leaves B - A x of a view in `given`; zeros at masked pixels.
    fn difference(&mut self, view: usize, x: &[T]) -> Result<(), LiftError> {
        let width = self.channels.len();
        self.read(view)?;
        self.drawn.resize(self.given.len(), T::ZERO);
        self.operator.forward(view, x, width, &mut self.drawn)?;
        let (factors, drawn) = (&self.rows.factors[view], &self.drawn);
        parallel::for_chunks(&mut self.given, GRAIN * width, |chunk, given| {
            let drawn = drawn[chunk * GRAIN * width..].chunks_exact(width);
            for ((row, drawn), factor) in given.chunks_exact_mut(width).zip(drawn).zip(&factors[chunk * GRAIN..]) {
                if *factor != T::ZERO {
                    row.iter_mut().zip(drawn).for_each(|(x, drawn)| *x -= *drawn);
                }
            }
        });
        Ok(())
    }
}

/// The sum of squares, in a fixed order.
fn squares<T: Real>(values: &[T]) -> f64 {
    let mut sums = vec![0.0; values.len().div_ceil(GRAIN)];
    parallel::for_chunks(&mut sums, 1, |chunk, sum| {
        let values = &values[chunk * GRAIN..values.len().min((chunk + 1) * GRAIN)];
        sum[0] = values.iter().map(|x| x.to_f64() * x.to_f64()).sum();
    });
    sums.iter().sum()
}

/// For each channel `sum_j scale_j a_jc b_jc`, in a fixed order; `a` and `b` are `[P, channels]`.
pub(crate) fn dots<T: Real>(scale: impl Fn(usize) -> f64 + Sync, a: &[T], b: &[T], channels: usize) -> Vec<f64> {
    let chunks = a.len().div_ceil(GRAIN * channels);
    let mut parts = vec![0.0; chunks * channels];
    parallel::for_chunks(&mut parts, channels, |chunk, sums| {
        let range = chunk * GRAIN * channels..a.len().min((chunk + 1) * GRAIN * channels);
        let rows = a[range.clone()].chunks_exact(channels).zip(b[range].chunks_exact(channels));
        for (j, (a, b)) in rows.enumerate() {
            let scale = scale(chunk * GRAIN + j);
            sums.iter_mut().zip(a.iter().zip(b)).for_each(|(sum, (a, b))| *sum += scale * a.to_f64() * b.to_f64());
        }
    });
    let mut total = vec![0.0; channels];
    for part in parts.chunks_exact(channels) {
        total.iter_mut().zip(part).for_each(|(total, x)| *total += x);
    }
    total
}

/// Runs `body(j, row)` on the rows of `x` `[P, channels]`, in parallel.
pub(crate) fn for_rows<T: Send>(x: &mut [T], channels: usize, body: impl Fn(usize, &mut [T]) + Sync) {
    parallel::for_chunks(x, GRAIN * channels, |chunk, rows| {
        rows.chunks_exact_mut(channels).enumerate().for_each(|(i, row)| body(chunk * GRAIN + i, row));
    });
}
