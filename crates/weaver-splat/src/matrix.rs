//! Products of the 2x3 and 3x3 matrices that projection is made of.

use weaver_kernels::Real;

/// A row vector or a point.
pub(crate) type Vec3<T> = [T; 3];
/// Two rows of three: a map from space to the image plane.
pub(crate) type Mat23<T> = [[T; 3]; 2];
/// Three rows of three.
pub(crate) type Mat33<T> = [[T; 3]; 3];

/// a . b
#[inline(always)]
pub(crate) fn dot<T: Real>(a: Vec3<T>, b: Vec3<T>) -> T {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

/// a x b
#[inline(always)]
pub(crate) fn cross<T: Real>(a: Vec3<T>, b: Vec3<T>) -> Vec3<T> {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

/// A v
#[inline(always)]
pub(crate) fn apply<T: Real>(a: &Mat33<T>, v: Vec3<T>) -> Vec3<T> {
    [dot(a[0], v), dot(a[1], v), dot(a[2], v)]
}

/// A^T v
#[inline(always)]
pub(crate) fn apply_transposed<T: Real>(a: &Mat33<T>, v: Vec3<T>) -> Vec3<T> {
    std::array::from_fn(|j| a[0][j] * v[0] + a[1][j] * v[1] + a[2][j] * v[2])
}

/// A B for a 2x3 and a 3x3 matrix.
#[inline(always)]
pub(crate) fn product<T: Real>(a: &Mat23<T>, b: &Mat33<T>) -> Mat23<T> {
    a.map(|row| apply_transposed(b, row))
}

/// A B^T for a 2x3 and a 3x3 matrix.
#[inline(always)]
pub(crate) fn product_transposed<T: Real>(a: &Mat23<T>, b: &Mat33<T>) -> Mat23<T> {
    a.map(|row| apply(b, row))
}

/// A^T B for two 2x3 matrices.
#[inline(always)]
pub(crate) fn transposed_product<T: Real>(a: &Mat23<T>, b: &Mat23<T>) -> Mat33<T> {
    std::array::from_fn(|i| std::array::from_fn(|j| a[0][i] * b[0][j] + a[1][i] * b[1][j]))
}

/// The inverse of a 3x3 matrix, in `f64`; not finite where it is singular.
pub(crate) fn inverse<T: Real>(a: &Mat33<T>) -> Mat33<f64> {
    let a = a.map(|row| row.map(T::to_f64));
    let cofactors = [cross(a[1], a[2]), cross(a[2], a[0]), cross(a[0], a[1])];
    let determinant = dot(a[0], cofactors[0]);
    std::array::from_fn(|i| std::array::from_fn(|j| cofactors[j][i] / determinant))
}
