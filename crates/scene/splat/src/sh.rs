//! Colors from spherical harmonics, and their gradients.

use crate::each::each;
use crate::matrix::{Vec3, dot};
use std::ops::{Add, Mul, Neg, Sub};
use weaver_geometry::sh::basis;
use weaver_kernels::lanes::Lanes;

/// Lanes and their derivatives along x, y, z.
#[derive(Clone, Copy)]
struct Slope<V> {
    value: V,
    partial: Vec3<V>,
}

impl<V: Lanes> Slope<V> {
    #[inline(always)]
    fn constant(x: f64) -> Self {
        Self { value: V::constant(x), partial: [V::zero(); 3] }
    }

    #[inline(always)]
    fn inputs(x: Vec3<V>) -> [Self; 3] {
        let (zero, one) = (V::zero(), V::constant(1.0));
        each!(3, |i| Self { value: x[i], partial: each!(3, |j| if i == j { one } else { zero }) })
    }
}

impl<V: Lanes> Add for Slope<V> {
    type Output = Self;
    #[inline(always)]
    fn add(self, b: Self) -> Self {
        Self { value: self.value + b.value, partial: each!(3, |i| self.partial[i] + b.partial[i]) }
    }
}

impl<V: Lanes> Sub for Slope<V> {
    type Output = Self;
    #[inline(always)]
    fn sub(self, b: Self) -> Self {
        Self { value: self.value - b.value, partial: each!(3, |i| self.partial[i] - b.partial[i]) }
    }
}

impl<V: Lanes> Mul for Slope<V> {
    type Output = Self;
    #[inline(always)]
    fn mul(self, b: Self) -> Self {
        let partial = each!(3, |i| self.partial[i].mul_add(b.value, self.value * b.partial[i]));
        Self { value: self.value * b.value, partial }
    }
}

impl<V: Lanes> Neg for Slope<V> {
    type Output = Self;
    #[inline(always)]
    fn neg(self) -> Self {
        Self { value: -self.value, partial: each!(3, |i| -self.partial[i]) }
    }
}

/// The unit vector along `v`, and 1 / |v|.
#[inline(always)]
fn direction<V: Lanes>(v: Vec3<V>) -> (Vec3<V>, V) {
    let inverse_length = V::constant(1.0) / dot(v, v).sqrt();
    (each!(3, |i| v[i] * inverse_length), inverse_length)
}

/// sum over k of b_k(v / |v|) coefficients_k + 0.5, before the clamp at zero, and a number that is 0 if all
/// coefficients are finite. Coefficient k of channel c is `coefficients[3 k + c]`.
#[inline(always)]
pub(crate) fn color<V: Lanes>(degree: usize, v: Vec3<V>, coefficients: &[V]) -> (Vec3<V>, V) {
    let unit = if degree == 0 { [V::zero(); 3] } else { direction(v).0 };
    let b = basis(degree, unit, V::constant);
    let zero = V::zero();
    let mut color = [V::constant(0.5); 3];
    let mut unsound = zero;
    for (b, term) in b.iter().zip(coefficients.as_chunks::<3>().0).take((degree + 1) * (degree + 1)) {
        for channel in 0..3 {
            color[channel] = b.mul_add(term[channel], color[channel]);
            unsound = term[channel].mul_add(zero, unsound);
        }
    }
    (color, unsound)
}

/// Backward of `max(`[`color`]`, 0)`: adds `dcolor` times the basis to `dcoefficients`, laid out as `coefficients`, in
/// the channels that are not clamped, and returns the gradient with respect to v.
#[inline(always)]
pub(crate) fn color_backward<V: Lanes>(
    degree: usize,
    v: Vec3<V>,
    coefficients: &[V],
    dcolor: Vec3<V>,
    dcoefficients: &mut [V],
) -> Vec3<V> {
    let terms = (degree + 1) * (degree + 1);
    let coefficients = &coefficients.as_chunks::<3>().0[..terms];
    let (unit, inverse_length) = if degree == 0 { ([V::zero(); 3], V::zero()) } else { direction(v) };
    let b = basis(degree, Slope::inputs(unit), Slope::constant);
    // The sum again, with the same rounding: cheaper than to fetch the forward pass's value.
    let mut sum = [V::constant(0.5); 3];
    for (b, term) in b.iter().zip(coefficients) {
        for channel in 0..3 {
            sum[channel] = b.value.mul_add(term[channel], sum[channel]);
        }
    }
    let dcolor = each!(3, |i| dcolor[i].only(sum[i].gt(V::zero())));
    let mut dunit = [V::zero(); 3];
    for (b, (term, dterm)) in b.iter().zip(coefficients.iter().zip(dcoefficients.as_chunks_mut::<3>().0)) {
        let weight = dot(dcolor, *term);
        for i in 0..3 {
            dterm[i] = dcolor[i].mul_add(b.value, dterm[i]);
            dunit[i] = weight.mul_add(b.partial[i], dunit[i]);
        }
    }
    let along = dot(unit, dunit);
    each!(3, |i| (dunit[i] - unit[i] * along) * inverse_length)
}
