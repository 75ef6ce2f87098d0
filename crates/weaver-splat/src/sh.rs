//! Real spherical harmonics, degree 0 to 4, with the signs and the order of the reference 3DGS implementation.

use crate::each::each;
use crate::matrix::{Ring, Vec3, dot};
use std::ops::{Add, Mul, Neg, Sub};
use weaver_kernels::lanes::Lanes;

/// Number of coefficients per channel at the largest degree, 4.
pub(crate) const MAX_TERMS: usize = 25;

/// The largest degree supported.
pub const MAX_DEGREE: usize = 4;

/// The basis functions of degree 0 to `degree` in the direction of the unit vector (x, y, z); the rest of the
/// array is zero. `c` makes constants.
#[inline(always)]
pub(crate) fn basis<X: Ring + Neg<Output = X>>(
    degree: usize,
    [x, y, z]: [X; 3],
    c: impl Fn(f64) -> X,
) -> [X; MAX_TERMS] {
    let mut b = [c(0.0); MAX_TERMS];
    b[0] = c(0.282_094_791_773_878_14);
    if degree < 1 {
        return b;
    }
    let first = c(0.488_602_511_902_919_9);
    b[1] = -(first * y);
    b[2] = first * z;
    b[3] = -(first * x);
    if degree < 2 {
        return b;
    }
    let (xx, yy, zz, xy, yz, xz) = (x * x, y * y, z * z, x * y, y * z, x * z);
    b[4] = c(1.092_548_430_592_079_2) * xy;
    b[5] = c(-1.092_548_430_592_079_2) * yz;
    b[6] = c(0.315_391_565_252_520_05) * (zz + zz - xx - yy);
    b[7] = c(-1.092_548_430_592_079_2) * xz;
    b[8] = c(0.546_274_215_296_039_6) * (xx - yy);
    if degree < 3 {
        return b;
    }
    let four = c(4.0) * zz - xx - yy;
    b[9] = c(-0.590_043_589_926_643_5) * y * (c(3.0) * xx - yy);
    b[10] = c(2.890_611_442_640_554) * xy * z;
    b[11] = c(-0.457_045_799_464_465_8) * y * four;
    b[12] = c(0.373_176_332_590_115_4) * z * (c(2.0) * zz - c(3.0) * (xx + yy));
    b[13] = c(-0.457_045_799_464_465_8) * x * four;
    b[14] = c(1.445_305_721_320_277) * z * (xx - yy);
    b[15] = c(-0.590_043_589_926_643_5) * x * (xx - c(3.0) * yy);
    if degree < 4 {
        return b;
    }
    let seven = c(7.0) * zz;
    b[16] = c(2.503_342_941_796_704_6) * xy * (xx - yy);
    b[17] = c(-1.770_130_769_779_930_4) * yz * (c(3.0) * xx - yy);
    b[18] = c(0.946_174_695_757_560_1) * xy * (seven - c(1.0));
    b[19] = c(-0.669_046_543_557_289_2) * yz * (seven - c(3.0));
    b[20] = c(0.105_785_546_915_204_31) * (zz * (c(35.0) * zz - c(30.0)) + c(3.0));
    b[21] = c(-0.669_046_543_557_289_2) * xz * (seven - c(3.0));
    b[22] = c(0.473_087_347_878_780_04) * (xx - yy) * (seven - c(1.0));
    b[23] = c(-1.770_130_769_779_930_4) * xz * (xx - c(3.0) * yy);
    b[24] = c(0.625_835_735_449_176_1) * (xx * (xx - c(3.0) * yy) - yy * (c(3.0) * xx - yy));
    b
}

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

/// sum over k of b_k(v / |v|) coefficients_k + 0.5, before the clamp at zero, and a number that is 0 if all coefficients
/// are finite. Coefficient k of channel c is `coefficients[3 k + c]`.
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
    // The sum again, with the same rounding: cheaper than to fetch what forward found.
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

#[cfg(test)]
mod tests {
    use super::*;
    use weaver_autograd::Dual;
    use weaver_kernels::random::Stream;

    #[test]
    fn basis_is_that_of_the_reference() {
        let stream = Stream::new(0, 0, "splat.sh");
        for i in 0..50 {
            let v: Vec3<f64> = std::array::from_fn(|axis| stream.normal(3 * i + axis as u64));
            let unit = v.map(|x| x / dot(v, v).sqrt());
            let expected = weaver_geometry::sh::basis(unit);
            let slopes = weaver_geometry::sh::gradient(unit);
            for degree in 0..=MAX_DEGREE {
                let ours = basis(degree, Dual::inputs(unit), Dual::constant);
                for k in 0..(degree + 1) * (degree + 1) {
                    assert!((ours[k].value - expected[k]).abs() < 1e-14, "{k}");
                    // Only the part along the sphere counts: on it, x^2 + y^2 + z^2 may be written as 1.
                    let along = |g: [f64; 3]| -> [f64; 3] {
                        let radial = dot(g, unit);
                        std::array::from_fn(|axis| g[axis] - radial * unit[axis])
                    };
                    let (a, b) = (along(ours[k].partial), along(slopes[k]));
                    assert!((0..3).all(|axis| (a[axis] - b[axis]).abs() < 1e-13), "{k}: {a:?} {b:?}");
                }
            }
        }
    }
}
