//! The Gaussian error linear unit, GELU(x) = x P(x) with the standard normal distribution function P (Hendrycks and
//! Gimpel 2016, arXiv 1606.08415). This is the exact form, not the approximation by tanh.

use crate::Real;
use crate::lanes::{self, LaneKernel, Lanes, Vector};
use crate::parallel::for_chunks;
use crate::target::Target;

/// Elements of one task.
const GRAIN: usize = 1 << 13;

/// Coefficients in t = 1 / (1 + a SLOPE) of e^{a^2} erfc(a) / t for a >= 0, relative error 3e-8 before rounding.
const ERFC: [f32; 9] = [
    0.214_409_83,
    0.213_944_48,
    0.203_685_06,
    0.139_681_35,
    0.227_216_51,
    -0.156_835_42,
    0.359_335_4,
    -0.259_858_58,
    0.058_421_403,
];
const SLOPE: f32 = 0.38;

/// [`Vector::normal`] for processors with fused multiply-add.
#[inline(always)]
pub(crate) fn normal<V: Vector<Scalar = f32>>(x: V) -> (V, V) {
    use std::f32::consts::{FRAC_1_SQRT_2, LOG2_E};
    // Beyond 40 the results are exactly 0 or 1, and an infinity would produce NaN.
    let a = x.abs().min(V::splat(40.0));
    // e^{-x^2 / 2} is also a factor of the tail erfc(|x| / sqrt 2) / 2.
    let bell = (a * a * V::splat(-0.5 * LOG2_E)).exp2();
    let t = a.mul_add(V::splat(SLOPE * FRAC_1_SQRT_2), V::splat(1.0)).recip();
    let mut tail = V::splat(ERFC[8]);
    for k in (0..8).rev() {
        tail = tail.mul_add(t, V::splat(ERFC[k]));
    }
    let tail = tail * t * (bell * V::splat(0.5));
    let positive = x.gt(V::zero());
    let below = (V::splat(1.0) - tail).or(positive, tail);
    // NaN for NaN.
    let itself = x.ge(x);
    (below.or(itself, x), (bell * V::splat(0.398_942_3)).or(itself, x))
}

/// GELU of every element: y = x P(x), where P(x) is the probability that a standard normal variable is less than x.
///
/// ```
/// use weaver_kernels::gelu::gelu_forward;
/// let mut y = [0.0_f64; 2];
/// gelu_forward(&[0.0, 1.0], &mut y);
/// assert!(y[0] == 0.0 && (y[1] - 0.841_344_746_068_542_9).abs() < 1e-14);
/// ```
#[inline(never)]
pub fn gelu_forward<T: Real>(x: &[T], y: &mut [T]) {
    assert_eq!(x.len(), y.len(), "gelu: lengths");
    for_chunks(y, GRAIN, |chunk, y| {
        lanes::run(Forward { x: &x[chunk * GRAIN..][..y.len()], y });
    });
}

/// Gradient of [`gelu_forward`] with respect to its input: dx = dy (P(x) + x P'(x)).
#[inline(never)]
pub fn gelu_backward<T: Real>(x: &[T], dy: &[T], dx: Target<T>) {
    let (dx, beta) = dx;
    assert_eq!((x.len(), x.len()), (dy.len(), dx.len()), "gelu: lengths");
    for_chunks(dx, GRAIN, |chunk, dx| {
        let part = chunk * GRAIN..chunk * GRAIN + dx.len();
        lanes::run(Backward { x: &x[part.clone()], dy: &dy[part], dx, beta });
    });
}

struct Forward<'a, T> {
    x: &'a [T],
    y: &'a mut [T],
}

impl<T: Real> LaneKernel<T> for Forward<'_, T> {
    type Output = ();

    #[inline(always)]
    fn run<V: Lanes<Scalar = T>>(self) {
        lanes::map::<V, 1>(
            [self.x],
            self.y,
            #[inline(always)]
            |[x], _| x * x.normal().0,
        );
    }
}

struct Backward<'a, T> {
    x: &'a [T],
    dy: &'a [T],
    dx: &'a mut [T],
    beta: T,
}

impl<T: Real> LaneKernel<T> for Backward<'_, T> {
    type Output = ();

    #[inline(always)]
    fn run<V: Lanes<Scalar = T>>(self) {
        let (write, beta) = (self.beta == T::ZERO, V::splat(self.beta));
        lanes::map::<V, 2>(
            [self.x, self.dy],
            self.dx,
            #[inline(always)]
            |[x, dy], old| {
                let (below, density) = x.normal();
                let dx = dy * x.mul_add(density, below);
                // With beta 0, the old value may be anything, NaN included.
                if write { dx } else { beta.mul_add(old, dx) }
            },
        );
    }
}
