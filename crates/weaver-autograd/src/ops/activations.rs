//! Elementwise functions of one tensor.

use crate::{Var, pointwise};
use weaver_kernels::Real;

pointwise!(
    /// x if positive, else 0; derivative 0 at 0.
    pub Relu, 1, |x| if x.value <= T::ZERO { 0.into() } else { x }
);
pointwise!(
    /// 1 / (1 + e^-x).
    pub Sigmoid, 1, |x| x.sigmoid()
);
pointwise!(
    /// Hyperbolic tangent.
    pub Tanh, 1, |x| x.tanh()
);
pointwise!(
    /// x / (1 + e^-x).
    pub Silu, 1, |x| x * x.sigmoid()
);
pointwise!(
    /// ln(1 + e^x).
    pub Softplus, 1, |x| x.softplus()
);
pointwise!(
    /// e^x.
    pub Exp, 1, |x| x.exp()
);
pointwise!(
    /// Natural logarithm.
    pub Ln, 1, |x| x.ln()
);
pointwise!(
    /// Square root.
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
    /// The nearest number in [lo, hi]; derivative 1 from lo to hi inclusive, else 0.
    pub Clamp { lo: f64, hi: f64 }, 1, |x| x.max(lo).min(hi)
);

impl<'t, T: Real> Var<'t, T> {
    /// max(x, 0); derivative 0 at 0. NaN gives NaN.
    pub fn relu(self) -> Self {
        self.map(Relu)
    }

    /// The logistic function 1 / (1 + e^-x).
    pub fn sigmoid(self) -> Self {
        self.map(Sigmoid)
    }

    /// Hyperbolic tangent.
    pub fn tanh(self) -> Self {
        self.map(Tanh)
    }

    /// x sigmoid(x), also known as swish.
    pub fn silu(self) -> Self {
        self.map(Silu)
    }

    /// ln(1 + e^x), computed as max(x, 0) + ln(1 + e^-|x|): no overflow.
    pub fn softplus(self) -> Self {
        self.map(Softplus)
    }

    /// e^x.
    pub fn exp(self) -> Self {
        self.map(Exp)
    }

    /// Natural logarithm, for positive x.
    pub fn ln(self) -> Self {
        self.map(Ln)
    }

    /// Square root; its derivative is infinite at 0.
    pub fn sqrt(self) -> Self {
        self.map(Sqrt)
    }

    /// x^2.
    pub fn square(self) -> Self {
        self.map(Square)
    }

    /// |x|; derivative 0 at 0.
    pub fn abs(self) -> Self {
        self.map(Abs)
    }

    /// The nearest number in [lo, hi]. The gradient passes where lo <= x <= hi, bounds included, and is 0 elsewhere.
    #[track_caller]
    pub fn clamp(self, lo: f64, hi: f64) -> Self {
        assert!(lo <= hi, "clamp: the bounds {lo} and {hi} are in the wrong order");
        self.map(Clamp { lo, hi })
    }
}
