//! The four solvers.

use crate::error::LiftError;
use crate::observations::Observations;
use crate::operator::Operator;
use crate::passes::{Passes, dots, for_rows};
use weaver_kernels::Real;

/// Solvers of Gaussians' features from features of pixels. `A` is the [`Operator`], `B` the features of the pixels,
/// `D_j = sum_i A_ij`.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub enum Solver {
    /// `x_j = (A^T B)_j / D_j`: the weighted mean over a Gaussian's pixels. Minimizes `sum_ij A_ij |x_j - B_i|^2`.
    RowSum,
    /// `x_j = sum_i A_ij^2 B_i / sum_i A_ij^2`: pixels dominated by the Gaussian weigh more.
    Squared,
    /// Least squares: minimizes `|A X - B|^2`, from zeros.
    Exact {
        /// Descent to the minimum.
        descent: Descent,
        /// Stopping rule.
        stop: Stop,
    },
    /// Minimizes `|A X - B|^2 + mu sum_j D_j |x_j - x'_j|^2` by conjugate gradients, x' from [`RowSum`](Self::RowSum):
    /// between x' (mu large) and [`Exact`](Self::Exact) (mu = 0).
    Damped {
        /// mu, not negative.
        mu: f64,
        /// Stopping rule.
        stop: Stop,
    },
}

/// Ways down to the least squares.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Descent {
    /// `X += D^-1 A^T (B - A X)`. The first pass gives [`Solver::RowSum`], and none raises the loss, for `A^T A <= D`
    /// if rows sum to at most 1.
    Iteration,
    /// Conjugate gradients on `A^T A`, preconditioned by D: fewer passes to the minimum, one more vector in memory.
    ConjugateGradients,
}

/// Stopping rule of the descent.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Stop {
    /// Most passes over the views, at least 1.
    pub passes: usize,
    /// A channel ends once `|D^-1/2 A^T (B - A X)|` is below this part of its first value.
    pub tolerance: f64,
}

impl Default for Stop {
    /// Five passes: further ones fit the borders of objects in the pixels at the cost of the Gaussians.
    fn default() -> Self {
        Self { passes: 5, tolerance: 1e-6 }
    }
}

impl Solver {
    /// [`Exact`](Self::Exact) by iteration with at most `passes` passes.
    pub fn exact(passes: usize) -> Self {
        Self::Exact { descent: Descent::Iteration, stop: Stop { passes, ..Stop::default() } }
    }

    /// Most passes over the views for each block of channels.
    pub fn passes(&self) -> usize {
        match self {
            Self::RowSum | Self::Squared => 1,
            Self::Exact { stop, .. } => stop.passes,
            // And one for x'.
            Self::Damped { stop, .. } => stop.passes + 1,
        }
    }

    /// True if features of photos have to be multiplied by alpha first: the solver compares them with features drawn
    /// over zeros.
    pub fn draws(&self) -> bool {
        matches!(self, Self::Exact { .. } | Self::Damped { .. })
    }

    pub(crate) fn check(&self) -> Result<(), LiftError> {
        let (mu, stop) = match *self {
            Self::RowSum | Self::Squared => return Ok(()),
            Self::Exact { stop, .. } => (0.0, stop),
            Self::Damped { mu, stop } => (mu, stop),
        };
        let refuse = |key, expected, found| Err(LiftError::Setting { key, expected, found });
        if !(mu >= 0.0 && mu.is_finite()) {
            return refuse("mu", "a number of at least 0", mu);
        }
        if stop.passes == 0 {
            return refuse("passes", "at least 1", 0.0);
        }
        if stop.tolerance.is_nan() || stop.tolerance < 0.0 {
            return refuse("tolerance", "a number of at least 0", stop.tolerance);
        }
        Ok(())
    }
}

/// 1 / D, and 0 for unseen Gaussians.
fn inverse<T: Real>(d: T) -> T {
    if d == T::ZERO { T::ZERO } else { T::ONE / d }
}

/// Divides weighted sums by their weights.
fn divide<T: Real>(x: &mut [T], weights: &[T], channels: usize) {
    for_rows(x, channels, |j, row| {
        let weight = inverse(weights[j]);
        row.iter_mut().for_each(|x| *x *= weight);
    });
}

impl<T: Real, O: Operator<T>, B: Observations<T>> Passes<'_, T, O, B> {
    pub fn row_sum(&mut self, x: &mut [T]) -> Result<(), LiftError> {
        self.gather(x)?;
        divide(x, &self.rows.seen, self.width());
        Ok(())
    }

    pub fn squared(&mut self, x: &mut [T]) -> Result<(), LiftError> {
        self.gather_squared(x)?;
        divide(x, &self.rows.squares, self.width());
        Ok(())
    }

    /// Descends by iteration; returns the number of passes.
    pub fn iterate(&mut self, x: &mut [T], stop: Stop) -> Result<usize, LiftError> {
        let channels = self.width();
        let weights = &self.rows.seen;
        let mut step = vec![T::ZERO; x.len()];
        let mut open = Open::new(channels, stop.tolerance);
        x.fill(T::ZERO);
        for pass in 0..stop.passes {
            match pass {
                0 => self.gather(&mut step)?,
                _ => self.residual(x, &mut step)?,
            }
            open.close(&dots(|j| inverse(weights[j].to_f64()), &step, &step, channels));
            if open.is_empty() {
                return Ok(pass + 1);
            }
            for_rows(x, channels, |j, row| {
                let weight = inverse(weights[j]);
                for (c, x) in row.iter_mut().enumerate().filter(|(c, _)| open.contains(*c)) {
                    *x += weight * step[j * channels + c];
                }
            });
        }
        Ok(stop.passes)
    }

    /// Conjugate gradients on `(A^T A + mu D) X = A^T B + mu D x'` from x', the initial value of `x`, preconditioned by
    /// D. Returns the number of passes.
    pub fn conjugate_gradients(&mut self, x: &mut [T], mu: f64, stop: Stop) -> Result<usize, LiftError> {
        let channels = self.width();
        let weights = &self.rows.seen;
        let scale = |j: usize| inverse(weights[j].to_f64());
        let [mut residual, mut product] = [(); 2].map(|()| vec![T::ZERO; x.len()]);
        // At x' the damping vanishes.
        self.residual(x, &mut residual)?;
        let mut direction = residual.clone();
        divide(&mut direction, weights, channels);
        let mut squares = dots(scale, &residual, &residual, channels);
        let mut open = Open::new(channels, stop.tolerance);
        open.close(&squares);
        let mu = T::from_f64(mu);
        for pass in 1..stop.passes {
            if open.is_empty() {
                return Ok(pass);
            }
            self.normal(&direction, &mut product)?;
            for_rows(&mut product, channels, |j, row| {
                let weight = mu * weights[j];
                for (x, p) in row.iter_mut().zip(&direction[j * channels..]) {
                    *x += weight * *p;
                }
            });
            let curvature = dots(|_| 1.0, &direction, &product, channels);
            let length = |c: usize| if open.contains(c) { squares[c] / curvature[c] } else { 0.0 };
            let lengths: Vec<T> = (0..channels).map(|c| T::from_f64(length(c))).collect();
            for_rows(x, channels, |j, row| {
                let steps = lengths.iter().zip(&direction[j * channels..]);
                row.iter_mut().zip(steps).for_each(|(x, (length, p))| *x += *length * *p);
            });
            for_rows(&mut residual, channels, |j, row| {
                let steps = lengths.iter().zip(&product[j * channels..]);
                row.iter_mut().zip(steps).for_each(|(r, (length, q))| *r -= *length * *q);
            });
            let next = dots(scale, &residual, &residual, channels);
            let turn = |c: usize| if open.contains(c) { next[c] / squares[c] } else { 0.0 };
            let turns: Vec<T> = (0..channels).map(|c| T::from_f64(turn(c))).collect();
            for_rows(&mut direction, channels, |j, row| {
                let weight = inverse(weights[j]);
                let steps = turns.iter().zip(&residual[j * channels..]);
                row.iter_mut().zip(steps).for_each(|(p, (turn, r))| *p = weight * *r + *turn * *p);
            });
            squares = next;
            open.close(&squares);
        }
        Ok(stop.passes)
    }
}

/// Active channels. Each ends by itself, so that results do not depend on the size of blocks.
struct Open {
    /// Squared norm at the end of each channel; empty before the first one is known.
    ends: Vec<f64>,
    open: Vec<bool>,
    tolerance: f64,
}

impl Open {
    fn new(channels: usize, tolerance: f64) -> Self {
        Self { ends: Vec::new(), open: vec![true; channels], tolerance }
    }

    /// Ends channels by their squared norms, relative to the first ones.
    fn close(&mut self, squares: &[f64]) {
        if self.ends.is_empty() {
            self.ends = squares.iter().map(|x| self.tolerance * self.tolerance * x).collect();
            self.open = squares.iter().map(|x| *x > 0.0).collect();
            return;
        }
        for ((open, square), end) in self.open.iter_mut().zip(squares).zip(&self.ends) {
            *open &= *square > *end;
        }
    }

    fn contains(&self, channel: usize) -> bool {
        self.open[channel]
    }

    fn is_empty(&self) -> bool {
        !self.open.contains(&true)
    }
}
