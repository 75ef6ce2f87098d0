//! Dual numbers: a value and its partial derivatives, computed together.

use crate::Real;
use std::ops::{Add, Div, Mul, Neg, Sub};

/// A number together with its derivatives with respect to `N` inputs, for forward-mode differentiation.
///
/// ```
/// use weaver_kernels::Dual;
/// let [x, y] = Dual::inputs([3.0_f64, 4.0]);
/// let f = x * x / y;
/// assert_eq!((f.value, f.partial), (2.25, [1.5, -0.5625]));
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Dual<T, const N: usize> {
    /// The value.
    pub value: T,
    /// The derivative with respect to each input.
    pub partial: [T; N],
}

impl<T: Real, const N: usize> Dual<T, N> {
    /// A constant, whose derivatives are 0.
    #[inline(always)]
    pub fn constant(value: T) -> Self {
        Self { value, partial: [T::ZERO; N] }
    }

    /// The inputs: input i has derivative 1 with respect to itself and 0 with respect to the others.
    #[inline(always)]
    pub fn inputs(values: [T; N]) -> [Self; N] {
        std::array::from_fn(|i| {
            let mut dual = Self::constant(values[i]);
            dual.partial[i] = T::ONE;
            dual
        })
    }

    /// The chain rule: f(self), given the value and the derivative of f at `self.value`.
    #[inline(always)]
    pub fn chain(self, value: T, derivative: T) -> Self {
        Self { value, partial: self.partial.map(|p| p * derivative) }
    }

    /// e^x.
    #[inline(always)]
    pub fn exp(self) -> Self {
        let y = self.value.exp();
        self.chain(y, y)
    }

    /// Natural logarithm.
    #[inline(always)]
    pub fn ln(self) -> Self {
        self.chain(self.value.ln(), T::ONE / self.value)
    }

    /// ln(1 + x).
    #[inline(always)]
    pub fn ln_1p(self) -> Self {
        self.chain(self.value.ln_1p(), T::ONE / (T::ONE + self.value))
    }

    /// Square root.
    #[inline(always)]
    pub fn sqrt(self) -> Self {
        let y = self.value.sqrt();
        self.chain(y, T::from_f64(0.5) / y)
    }

    /// Sine.
    #[inline(always)]
    pub fn sin(self) -> Self {
        self.chain(self.value.sin(), self.value.cos())
    }

    /// Cosine.
    #[inline(always)]
    pub fn cos(self) -> Self {
        self.chain(self.value.cos(), -self.value.sin())
    }

    /// Tangent.
    #[inline(always)]
    pub fn tan(self) -> Self {
        let y = self.value.tan();
        self.chain(y, T::ONE + y * y)
    }

    /// Arc tangent.
    #[inline(always)]
    pub fn atan(self) -> Self {
        self.chain(self.value.atan(), T::ONE / (T::ONE + self.value * self.value))
    }

    /// Hyperbolic tangent.
    #[inline(always)]
    pub fn tanh(self) -> Self {
        let y = self.value.tanh();
        self.chain(y, T::ONE - y * y)
    }

    /// The logistic function 1 / (1 + e^-x), with a finite derivative for every finite x.
    #[inline(always)]
    pub fn sigmoid(self) -> Self {
        let y = T::ONE / (T::ONE + (-self.value).exp());
        self.chain(y, y * (T::ONE - y))
    }

    /// ln(1 + e^x), without overflow.
    #[inline(always)]
    pub fn softplus(self) -> Self {
        let y = self.value.max(T::ZERO) + (-self.value.abs()).exp().ln_1p();
        self.chain(y, self.sigmoid().value)
    }

    /// The Gauss error function.
    #[inline(always)]
    pub fn erf(self) -> Self {
        let slope = T::from_f64(std::f64::consts::FRAC_2_SQRT_PI) * (-self.value * self.value).exp();
        self.chain(self.value.erf(), slope)
    }

    /// |x|, with derivative 0 at 0.
    #[inline(always)]
    pub fn abs(self) -> Self {
        self.chain(self.value.abs(), sign(self.value))
    }

    /// The larger of two numbers; `self` if they are equal or one is NaN.
    #[inline(always)]
    pub fn max(self, other: impl Into<Self>) -> Self {
        let other = other.into();
        if self.value < other.value { other } else { self }
    }

    /// The smaller of two numbers; `self` if they are equal or one is NaN.
    #[inline(always)]
    pub fn min(self, other: impl Into<Self>) -> Self {
        let other = other.into();
        if self.value > other.value { other } else { self }
    }
}

/// The sign of x, -1, 0 or 1; NaN for NaN.
#[inline(always)]
fn sign<T: Real>(x: T) -> T {
    if x > T::ZERO {
        T::ONE
    } else if x < T::ZERO {
        -T::ONE
    } else {
        x * T::ZERO
    }
}

impl<T: Real, const N: usize> From<f64> for Dual<T, N> {
    #[inline(always)]
    fn from(x: f64) -> Self {
        Self::constant(T::from_f64(x))
    }
}

impl<T: Real, const N: usize> From<i32> for Dual<T, N> {
    #[inline(always)]
    fn from(x: i32) -> Self {
        Self::constant(T::from_f64(f64::from(x)))
    }
}

impl<T: Real, const N: usize> Neg for Dual<T, N> {
    type Output = Self;
    #[inline(always)]
    fn neg(self) -> Self {
        Self { value: -self.value, partial: self.partial.map(|p| -p) }
    }
}

impl<T: Real, const N: usize> Add for Dual<T, N> {
    type Output = Self;
    #[inline(always)]
    fn add(self, o: Self) -> Self {
        Self { value: self.value + o.value, partial: std::array::from_fn(|i| self.partial[i] + o.partial[i]) }
    }
}

impl<T: Real, const N: usize> Sub for Dual<T, N> {
    type Output = Self;
    #[inline(always)]
    fn sub(self, o: Self) -> Self {
        Self { value: self.value - o.value, partial: std::array::from_fn(|i| self.partial[i] - o.partial[i]) }
    }
}

#[allow(clippy::suspicious_arithmetic_impl, reason = "the product rule adds")]
impl<T: Real, const N: usize> Mul for Dual<T, N> {
    type Output = Self;
    #[inline(always)]
    fn mul(self, o: Self) -> Self {
        Self {
            value: self.value * o.value,
            partial: std::array::from_fn(|i| self.partial[i] * o.value + self.value * o.partial[i]),
        }
    }
}

#[allow(clippy::suspicious_arithmetic_impl, reason = "the quotient rule subtracts and multiplies")]
impl<T: Real, const N: usize> Div for Dual<T, N> {
    type Output = Self;
    #[inline(always)]
    fn div(self, o: Self) -> Self {
        let value = self.value / o.value;
        Self { value, partial: std::array::from_fn(|i| (self.partial[i] - value * o.partial[i]) / o.value) }
    }
}

macro_rules! with_literals {
    ($($op:ident $method:ident $number:ty),+) => {$(
        impl<T: Real, const N: usize> $op<$number> for Dual<T, N> {
            type Output = Self;
            #[inline(always)]
            fn $method(self, o: $number) -> Self {
                $op::$method(self, Self::from(o))
            }
        }
        impl<T: Real, const N: usize> $op<Dual<T, N>> for $number {
            type Output = Dual<T, N>;
            #[inline(always)]
            fn $method(self, o: Dual<T, N>) -> Dual<T, N> {
                $op::$method(Dual::from(self), o)
            }
        }
    )+};
}
with_literals!(Add add f64, Sub sub f64, Mul mul f64, Div div f64, Add add i32, Sub sub i32, Mul mul i32, Div div i32);
