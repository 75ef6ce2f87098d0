//! Real spherical harmonics up to degree 4, with the signs and the order of the reference 3DGS implementation.
//!
//! The order is by degree `l`, then `m = -l ..= l`; degree 1 is `(-y, z, -x)` times a constant. Directions are
//! of unit length, from the camera to the Gaussian.

use glam::{DMat3, DVec3};
use std::ops::{Add, Mul, Neg, Sub};

/// The largest supported degree.
pub const MAX_DEGREE: usize = 4;

/// Number of basis functions up to the largest degree.
pub const MAX_COEFFICIENTS: usize = coefficients(MAX_DEGREE);

/// The basis function of degree 0, `1 / (2 sqrt(pi))`: a color that is the same from all sides is `0.5 + DC *
/// coefficient`.
pub const DC: f64 = 0.282_094_791_773_878_14;

/// Number of basis functions up to a degree, `(degree + 1)^2`.
pub const fn coefficients(degree: usize) -> usize {
    (degree + 1) * (degree + 1)
}

/// The basis functions of degree 0 to `degree` at a unit direction.
///
/// They are the first [`coefficients`]`(degree)` entries of the array; the others are zero. `X` is any type of number,
/// such as a float, a SIMD vector or a dual number; `c` makes a constant of that type.
///
/// Sources: Ramamoorthi and Hanrahan, "An efficient representation for irradiance environment maps" (degrees to
/// 2); Sloan, "Efficient spherical harmonic evaluation" (beyond).
///
/// ```
/// use weaver_geometry::sh;
/// let basis = sh::basis(1, [0.0, 0.0, 1.0], |x: f64| x);
/// assert_eq!(basis[0], sh::DC);
/// assert!((basis[2] - 0.48860251).abs() < 1e-8);
/// ```
#[inline(always)]
pub fn basis<X>(degree: usize, [x, y, z]: [X; 3], c: impl Fn(f64) -> X) -> [X; MAX_COEFFICIENTS]
where
    X: Copy + Add<Output = X> + Sub<Output = X> + Mul<Output = X> + Neg<Output = X>,
{
    let mut b = [c(0.0); MAX_COEFFICIENTS];
    b[0] = c(DC);
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

/// The derivatives of all basis functions along the sphere, `[MAX_COEFFICIENTS, 3]`; each row is tangent to the sphere
/// at the unit direction `d`.
///
/// They are `(1 - d d^T)` times the gradients of the polynomials, which is the gradient with respect to `v` of the
/// basis at `d = v / |v|`, at `|v| = 1`.
pub fn gradient(direction: [f64; 3]) -> [[f64; 3]; MAX_COEFFICIENTS] {
    let axis = |i: usize| {
        let mut slope = [0.0; 3];
        slope[i] = 1.0;
        Dual { value: direction[i], slope }
    };
    basis(MAX_DEGREE, [axis(0), axis(1), axis(2)], Dual::constant).map(|Dual { slope, .. }| {
        let radial: f64 = slope.iter().zip(direction).map(|(s, d)| s * d).sum();
        std::array::from_fn(|i| slope[i] - radial * direction[i])
    })
}

/// The sign by which each coefficient is multiplied when the world turns half about a coordinate axis, 0 to 2:
/// [`rotation`] by 180 degrees, which is diagonal.
///
/// # Panics
/// When `axis` is above 2.
///
/// ```
/// use weaver_geometry::sh;
/// assert_eq!(sh::half_turn_signs(2)[..4], [1.0, -1.0, 1.0, -1.0]);
/// ```
pub fn half_turn_signs(axis: usize) -> [f32; MAX_COEFFICIENTS] {
    // A direction at which no function vanishes.
    let direction = [0.675, 0.337, 0.656];
    let mut turned = direction.map(|x: f64| -x);
    turned[axis] = direction[axis];
    let basis = |direction| basis(MAX_DEGREE, direction, |x| x);
    let (before, after) = (basis(direction), basis(turned));
    std::array::from_fn(|i| if before[i] * after[i] < 0.0 { -1.0 } else { 1.0 })
}

/// Matrices that rotate coefficients with the world, degree by degree: `[2 l + 1, 2 l + 1]` row by row for l from 1 to
/// `degree`, such that the rotated scene has, along a rotated direction, the color that the scene had along the
/// direction.
///
/// `basis(R d) . (M c) = basis(d) . c` for every direction d. Found from the basis at directions all over the sphere by
/// least squares, which are exact because degrees do not mix.
pub fn rotation(degree: usize, rotation: &DMat3) -> Vec<Vec<f64>> {
    /// More than the coefficients of the largest degree, and well spread.
    const DIRECTIONS: usize = 64;
    let golden = std::f64::consts::PI * (3.0 - 5.0_f64.sqrt());
    let directions = (0..DIRECTIONS).map(|i| {
        let z = 1.0 - (2 * i + 1) as f64 / DIRECTIONS as f64;
        let (sin, cos) = (golden * i as f64).sin_cos();
        let r = (1.0 - z * z).sqrt();
        DVec3::new(r * cos, r * sin, z)
    });
    let at = |d: DVec3| basis(MAX_DEGREE, d.to_array(), |x| x);
    let pairs: Vec<_> = directions.map(|d| (at(*rotation * d), at(d))).collect();
    (1..=degree.min(MAX_DEGREE))
        .map(|l| {
            let (first, n) = (coefficients(l - 1), 2 * l + 1);
            let mut normal = vec![0.0; n * n];
            let mut right = vec![0.0; n * n];
            for (turned, before) in &pairs {
                for i in 0..n {
                    for j in 0..n {
                        normal[i * n + j] += turned[first + i] * turned[first + j];
                        right[i * n + j] += turned[first + i] * before[first + j];
                    }
                }
            }
            solve(&mut normal, &mut right, n);
            right
        })
        .collect()
}

/// Solves `a x = b` for a positive definite a, both `[n, n]`; x replaces b.
fn solve(a: &mut [f64], b: &mut [f64], n: usize) {
    for p in 0..n {
        let pivot = a[p * n + p];
        for row in (0..n).filter(|row| *row != p) {
            let factor = a[row * n + p] / pivot;
            for k in 0..n {
                a[row * n + k] -= factor * a[p * n + k];
                b[row * n + k] -= factor * b[p * n + k];
            }
        }
    }
    for row in 0..n {
        let pivot = a[row * n + row];
        b[row * n..][..n].iter_mut().for_each(|x| *x /= pivot);
    }
}

/// A number and its derivatives with respect to x, y and z.
#[derive(Clone, Copy)]
struct Dual {
    value: f64,
    slope: [f64; 3],
}

impl Dual {
    fn constant(value: f64) -> Self {
        Self { value, slope: [0.0; 3] }
    }
}

impl Neg for Dual {
    type Output = Self;

    fn neg(self) -> Self {
        Self { value: -self.value, slope: self.slope.map(|s| -s) }
    }
}

impl Add for Dual {
    type Output = Self;

    fn add(self, b: Self) -> Self {
        let slope = std::array::from_fn(|i| self.slope[i] + b.slope[i]);
        Self { value: self.value + b.value, slope }
    }
}

impl Sub for Dual {
    type Output = Self;

    fn sub(self, b: Self) -> Self {
        let slope = std::array::from_fn(|i| self.slope[i] - b.slope[i]);
        Self { value: self.value - b.value, slope }
    }
}

impl Mul for Dual {
    type Output = Self;

    fn mul(self, b: Self) -> Self {
        let slope = std::array::from_fn(|i| self.slope[i].mul_add(b.value, self.value * b.slope[i]));
        Self { value: self.value * b.value, slope }
    }
}
