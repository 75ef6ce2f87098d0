//! Forward-mode dual numbers: a value and its derivatives with respect to `P` variables.

use std::ops::{Add, Div, Mul, Neg, Sub};
use weaver_kernels::Real;

/// What a formula needs of its numbers, so that it can be written once for values and for duals.
pub(crate) trait Scalar:
    Copy + Add<Output = Self> + Sub<Output = Self> + Mul<Output = Self> + Div<Output = Self> + Neg<Output = Self>
{
    /// A number that depends on nothing.
    fn constant(x: f64) -> Self;
}

impl<T: Real> Scalar for T {
    #[inline(always)]
    fn constant(x: f64) -> Self {
        T::from_f64(x)
    }
}

/// A value with its `P` partial derivatives.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Dual<T, const P: usize> {
    /// The value.
    pub value: T,
    /// Its derivatives.
    pub partials: [T; P],
}

impl<T: Real, const P: usize> Dual<T, P> {
    /// Variable number `index`.
    #[inline(always)]
    pub fn variable(value: T, index: usize) -> Self {
        let mut partials = [T::ZERO; P];
        partials[index] = T::ONE;
        Self { value, partials }
    }

    /// f(self), given the value and the derivative of f there.
    #[inline(always)]
    fn chain(self, value: T, derivative: T) -> Self {
        Self { value, partials: self.partials.map(|p| p * derivative) }
    }

    /// The square root.
    #[inline(always)]
    pub fn sqrt(self) -> Self {
        let root = self.value.sqrt();
        self.chain(root, T::ONE / (root + root))
    }
}

impl<T: Real, const P: usize> Scalar for Dual<T, P> {
    #[inline(always)]
    fn constant(x: f64) -> Self {
        Self { value: T::from_f64(x), partials: [T::ZERO; P] }
    }
}

impl<T: Real, const P: usize> Add for Dual<T, P> {
    type Output = Self;
    #[inline(always)]
    fn add(self, b: Self) -> Self {
        Self {
            value: self.value + b.value,
            partials: std::array::from_fn(|i| self.partials[i] + b.partials[i]),
        }
    }
}

impl<T: Real, const P: usize> Sub for Dual<T, P> {
    type Output = Self;
    #[inline(always)]
    fn sub(self, b: Self) -> Self {
        self + -b
    }
}

impl<T: Real, const P: usize> Mul for Dual<T, P> {
    type Output = Self;
    #[inline(always)]
    fn mul(self, b: Self) -> Self {
        Self {
            value: self.value * b.value,
            partials: std::array::from_fn(|i| self.partials[i] * b.value + self.value * b.partials[i]),
        }
    }
}

impl<T: Real, const P: usize> Div for Dual<T, P> {
    type Output = Self;
    #[inline(always)]
    fn div(self, b: Self) -> Self {
        let inverse = T::ONE / b.value;
        self * b.chain(inverse, -inverse * inverse)
    }
}

impl<T: Real, const P: usize> Neg for Dual<T, P> {
    type Output = Self;
    #[inline(always)]
    fn neg(self) -> Self {
        self.chain(-self.value, -T::ONE)
    }
}
