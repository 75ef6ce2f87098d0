//! Real spherical harmonics up to degree 4, signs and order of the reference 3DGS implementation.
//!
//! The order is by degree `l`, then `m = -l ..= l`; degree 1 is `(-y, z, -x)` times a constant. Directions are
//! of unit length, from the camera to the Gaussian.

use std::ops::{Add, Mul, Sub};

/// Number of basis functions up to degree 4.
pub const MAX_COEFFICIENTS: usize = 25;

/// Number of basis functions up to a degree, `(degree + 1)^2`.
pub const fn coefficients(degree: usize) -> usize {
    (degree + 1) * (degree + 1)
}

/// What the basis needs of a number.
pub trait Number: Copy + Add<Output = Self> + Sub<Output = Self> + Mul<Output = Self> {
    /// A constant of this type.
    fn constant(value: f64) -> Self;
}

impl Number for f64 {
    fn constant(value: f64) -> Self {
        value
    }
}

impl Number for f32 {
    fn constant(value: f64) -> Self {
        value as f32
    }
}

/// All basis functions at a unit direction; degree `l` and below are the first [`coefficients`]`(l)`.
///
/// Sources: Ramamoorthi and Hanrahan, "An efficient representation for irradiance environment maps" (degrees to
/// 2); Sloan, "Efficient spherical harmonic evaluation" (beyond).
///
/// ```
/// let basis = weaver_geometry::sh::basis([0.0, 0.0, 1.0f64]);
/// assert!((basis[0] - 0.28209479).abs() < 1e-8);
/// assert!((basis[2] - 0.48860251).abs() < 1e-8);
/// ```
pub fn basis<T: Number>([x, y, z]: [T; 3]) -> [T; MAX_COEFFICIENTS] {
    let c = T::constant;
    let (xx, yy, zz) = (x * x, y * y, z * z);
    let (xy, yz, xz) = (x * y, y * z, x * z);
    [
        c(0.28209479177387814),
        // Degree 1.
        c(-0.4886025119029199) * y,
        c(0.4886025119029199) * z,
        c(-0.4886025119029199) * x,
        // Degree 2.
        c(1.0925484305920792) * xy,
        c(-1.0925484305920792) * yz,
        c(0.31539156525252005) * (c(2.0) * zz - xx - yy),
        c(-1.0925484305920792) * xz,
        c(0.5462742152960396) * (xx - yy),
        // Degree 3.
        c(-0.5900435899266435) * y * (c(3.0) * xx - yy),
        c(2.890611442640554) * xy * z,
        c(-0.4570457994644658) * y * (c(4.0) * zz - xx - yy),
        c(0.3731763325901154) * z * (c(2.0) * zz - c(3.0) * xx - c(3.0) * yy),
        c(-0.4570457994644658) * x * (c(4.0) * zz - xx - yy),
        c(1.445305721320277) * z * (xx - yy),
        c(-0.5900435899266435) * x * (xx - c(3.0) * yy),
        // Degree 4.
        c(2.5033429417967046) * xy * (xx - yy),
        c(-1.7701307697799304) * yz * (c(3.0) * xx - yy),
        c(0.9461746957575601) * xy * (c(7.0) * zz - c(1.0)),
        c(-0.6690465435572892) * yz * (c(7.0) * zz - c(3.0)),
        c(0.10578554691520431) * (zz * (c(35.0) * zz - c(30.0)) + c(3.0)),
        c(-0.6690465435572892) * xz * (c(7.0) * zz - c(3.0)),
        c(0.47308734787878004) * (xx - yy) * (c(7.0) * zz - c(1.0)),
        c(-1.7701307697799304) * xz * (xx - c(3.0) * yy),
        c(0.6258357354491761) * (xx * (xx - c(3.0) * yy) - yy * (c(3.0) * xx - yy)),
    ]
}

/// Derivatives of every basis function along the sphere: `[MAX_COEFFICIENTS, 3]`, each row tangent to it at the
/// unit direction.
///
/// This is `(1 - d d^T)` times the gradient of the polynomials, hence what remains of it after the chain rule of
/// `d = v / |v|` with `|v| = 1`.
pub fn gradient(direction: [f64; 3]) -> [[f64; 3]; MAX_COEFFICIENTS] {
    let axis = |i: usize| {
        let mut slope = [0.0; 3];
        slope[i] = 1.0;
        Dual { value: direction[i], slope }
    };
    basis([axis(0), axis(1), axis(2)]).map(|Dual { slope, .. }| {
        let radial: f64 = slope.iter().zip(direction).map(|(s, d)| s * d).sum();
        std::array::from_fn(|i| slope[i] - radial * direction[i])
    })
}

/// A number and its derivatives with respect to x, y and z.
#[derive(Clone, Copy)]
struct Dual {
    value: f64,
    slope: [f64; 3],
}

impl Number for Dual {
    fn constant(value: f64) -> Self {
        Self { value, slope: [0.0; 3] }
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
