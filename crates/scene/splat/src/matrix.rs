//! Products of the 2x3 and 3x3 matrices that projection is made of, for numbers and for lanes of them.

use crate::each::each;
use std::ops::{Add, Mul, Sub};
use weaver_kernels::Real;

/// Numbers that can be added, subtracted and multiplied.
pub(crate) trait Ring: Copy + Add<Output = Self> + Sub<Output = Self> + Mul<Output = Self> {}
impl<X: Copy + Add<Output = X> + Sub<Output = X> + Mul<Output = X>> Ring for X {}

/// A row vector or a point.
pub(crate) type Vec3<T> = [T; 3];
/// Two rows of three: a map from space to the image plane.
pub(crate) type Mat23<T> = [[T; 3]; 2];
/// Three rows of three.
pub(crate) type Mat33<T> = [[T; 3]; 3];

/// a . b
#[inline(always)]
pub(crate) fn dot<X: Ring>(a: Vec3<X>, b: Vec3<X>) -> X {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

/// a x b
#[inline(always)]
pub(crate) fn cross<X: Ring>(a: Vec3<X>, b: Vec3<X>) -> Vec3<X> {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

/// A v
#[inline(always)]
pub(crate) fn apply<X: Ring>(a: &Mat33<X>, v: Vec3<X>) -> Vec3<X> {
    [dot(a[0], v), dot(a[1], v), dot(a[2], v)]
}

/// A^T v
#[inline(always)]
pub(crate) fn apply_transposed<X: Ring>(a: &Mat33<X>, v: Vec3<X>) -> Vec3<X> {
    each!(3, |j| a[0][j] * v[0] + a[1][j] * v[1] + a[2][j] * v[2])
}

/// A B for a 2x3 and a 3x3 matrix.
#[inline(always)]
pub(crate) fn product<X: Ring>(a: &Mat23<X>, b: &Mat33<X>) -> Mat23<X> {
    [apply_transposed(b, a[0]), apply_transposed(b, a[1])]
}

/// A B^T for a 2x3 and a 3x3 matrix.
#[inline(always)]
pub(crate) fn product_transposed<X: Ring>(a: &Mat23<X>, b: &Mat33<X>) -> Mat23<X> {
    [apply(b, a[0]), apply(b, a[1])]
}

/// A^T B for two 2x3 matrices.
#[inline(always)]
pub(crate) fn transposed_product<X: Ring>(a: &Mat23<X>, b: &Mat23<X>) -> Mat33<X> {
    each!(3, |i| each!(3, |j| a[0][i] * b[0][j] + a[1][i] * b[1][j]))
}

/// The inverse of a 3x3 matrix, in `f64`; not finite where it is singular.
pub(crate) fn inverse<T: Real>(a: &Mat33<T>) -> Mat33<f64> {
    let a = a.map(|row| row.map(T::to_f64));
    let cofactors = [cross(a[1], a[2]), cross(a[2], a[0]), cross(a[0], a[1])];
    let determinant = dot(a[0], cofactors[0]);
    std::array::from_fn(|i| std::array::from_fn(|j| cofactors[j][i] / determinant))
}
