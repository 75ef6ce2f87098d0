//! Elementwise functions of one tensor: the result has the shape of the input, in which it is differentiable.

use crate::{Var, pointwise};
use weaver_kernels::Real;

pointwise!(
    /// The rectified linear unit, max(x, 0); derivative 0 at 0.
    pub Relu, 1, |x| if x.value <= T::ZERO { 0.into() } else { x }
);
pointwise!(
    /// The logistic function, 1 / (1 + e^-x).
    pub Sigmoid, 1, |x| x.sigmoid()
);
pointwise!(
    /// The hyperbolic tangent.
    pub Tanh, 1, |x| x.tanh()
);
pointwise!(
    /// The sigmoid linear unit, x / (1 + e^-x).
    pub Silu, 1, |x| x * x.sigmoid()
);
pointwise!(
    /// The softplus function, ln(1 + e^x).
    pub Softplus, 1, |x| x.softplus()
);
pointwise!(
    /// e^x.
    pub Exp, 1, |x| x.exp()
);
pointwise!(
    /// The natural logarithm.
    pub Ln, 1, |x| x.ln()
);
pointwise!(
    /// The square root.
    pub Sqrt, 1, |x| x.sqrt()
);
pointwise!(
    /// x^2.
    pub Square, 1, |x| x * x
);
pointwise!(
    /// |x|.
    pub Abs, 1, |x| x.abs()
);
pointwise!(
    /// The nearest number in [lo, hi]; derivative 1 inside, bounds included, 0 outside.
    pub Clamp { lo: f64, hi: f64 }, 1, |x| x.max(lo).min(hi)
);

impl<'t, T: Real> Var<'t, T> {
    /// The rectified linear unit max(x, 0), elementwise; derivative 0 at 0. NaN gives NaN.
    ///
    /// The result has the shape of the input. Differentiable.
    ///
    /// ```
    /// use weaver_autograd::Tape;
    /// let tape = Tape::<f64>::new();
    /// assert_eq!(tape.constant(&[-1.0, 2.0], [2]).relu().to_vec(), [0.0, 2.0]);
    /// ```
    pub fn relu(self) -> Self {
        self.map(Relu)
    }

    /// The logistic function 1 / (1 + e^-x), elementwise.
    ///
    /// The result has the shape of the input. Differentiable.
    ///
    /// ```
    /// use weaver_autograd::Tape;
    /// let tape = Tape::<f64>::new();
    /// assert_eq!(tape.scalar(0.0).sigmoid().item(), 0.5);
    /// ```
    pub fn sigmoid(self) -> Self {
        self.map(Sigmoid)
    }

    /// The hyperbolic tangent, elementwise.
    ///
    /// The result has the shape of the input. Differentiable.
    ///
    /// ```
    /// use weaver_autograd::Tape;
    /// let tape = Tape::<f64>::new();
    /// assert_eq!(tape.scalar(0.0).tanh().item(), 0.0);
    /// ```
    pub fn tanh(self) -> Self {
        self.map(Tanh)
    }

    /// The sigmoid linear unit x / (1 + e^-x), elementwise; also known as swish (Elfwing et al., arXiv 1702.03118).
    ///
    /// The result has the shape of the input. Differentiable.
    ///
    /// ```
    /// use weaver_autograd::Tape;
    /// let tape = Tape::<f64>::new();
    /// assert_eq!(tape.constant(&[0.0, 200.0], [2]).silu().to_vec(), [0.0, 200.0]);
    /// ```
    pub fn silu(self) -> Self {
        self.map(Silu)
    }

    /// The softplus function ln(1 + e^x), elementwise, computed without overflow as max(x, 0) + ln(1 + e^-|x|).
    ///
    /// The result has the shape of the input. Differentiable.
    ///
    /// ```
    /// use weaver_autograd::Tape;
    /// let tape = Tape::<f64>::new();
    /// assert_eq!(tape.constant(&[-1000.0, 1000.0], [2]).softplus().to_vec(), [0.0, 1000.0]);
    /// ```
    pub fn softplus(self) -> Self {
        self.map(Softplus)
    }

    /// The exponential e^x, elementwise.
    ///
    /// The result has the shape of the input. Differentiable.
    ///
    /// ```
    /// use weaver_autograd::Tape;
    /// let tape = Tape::<f64>::new();
    /// assert_eq!(tape.scalar(0.0).exp().item(), 1.0);
    /// ```
    pub fn exp(self) -> Self {
        self.map(Exp)
    }

    /// The natural logarithm, elementwise, for positive x; minus infinity at 0, NaN below.
    ///
    /// The result has the shape of the input. Differentiable.
    ///
    /// ```
    /// use weaver_autograd::Tape;
    /// let tape = Tape::<f64>::new();
    /// assert_eq!(tape.constant(&[1.0, 0.0], [2]).ln().to_vec(), [0.0, f64::NEG_INFINITY]);
    /// ```
    pub fn ln(self) -> Self {
        self.map(Ln)
    }

    /// The square root, elementwise; NaN below 0, and at 0 its derivative is infinite.
    ///
    /// The result has the shape of the input. Differentiable.
    ///
    /// ```
    /// use weaver_autograd::Tape;
    /// let tape = Tape::<f64>::new();
    /// assert_eq!(tape.scalar(9.0).sqrt().item(), 3.0);
    /// ```
    pub fn sqrt(self) -> Self {
        self.map(Sqrt)
    }

    /// The square x^2, elementwise.
    ///
    /// The result has the shape of the input. Differentiable.
    ///
    /// ```
    /// use weaver_autograd::Tape;
    /// let tape = Tape::<f64>::new();
    /// assert_eq!(tape.scalar(-3.0).square().item(), 9.0);
    /// ```
    pub fn square(self) -> Self {
        self.map(Square)
    }

    /// The absolute value |x|, elementwise; derivative 0 at 0.
    ///
    /// The result has the shape of the input. Differentiable.
    ///
    /// ```
    /// use weaver_autograd::Tape;
    /// let tape = Tape::<f64>::new();
    /// assert_eq!(tape.constant(&[-1.0, 2.0], [2]).abs().to_vec(), [1.0, 2.0]);
    /// ```
    pub fn abs(self) -> Self {
        self.map(Abs)
    }

    /// Clamps every element to [lo, hi]: min(max(x, lo), hi). The gradient passes where lo <= x <= hi, bounds included,
    /// and is 0 elsewhere.
    ///
    /// The result has the shape of the input. Differentiable; the bounds are constant. Panics if lo > hi.
    ///
    /// ```
    /// use weaver_autograd::Tape;
    /// let tape = Tape::<f64>::new();
    /// assert_eq!(tape.constant(&[-1.0, 0.5, 2.0], [3]).clamp(0.0, 1.0).to_vec(), [0.0, 0.5, 1.0]);
    /// ```
    #[track_caller]
    pub fn clamp(self, lo: f64, hi: f64) -> Self {
        assert!(lo <= hi, "clamp: the bounds {lo} and {hi} are in the wrong order");
        self.map(Clamp { lo, hi })
    }
}
