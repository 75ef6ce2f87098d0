//! Rotation matrices of quaternions (xyzw), on dual numbers.

use weaver_kernels::{Dual, Real};

/// A quaternion in xyzw order, on dual numbers.
pub(crate) type Quaternion<T, const N: usize> = [Dual<T, N>; 4];

/// The rotation matrix (row-major) of a quaternion of any length but 0.
pub(crate) fn matrix<T: Real, const N: usize>([x, y, z, w]: Quaternion<T, N>) -> [Dual<T, N>; 9] {
    let s = 2 / (x * x + y * y + z * z + w * w);
    [
        1 - s * (y * y + z * z),
        s * (x * y - z * w),
        s * (x * z + y * w),
        s * (x * y + z * w),
        1 - s * (x * x + z * z),
        s * (y * z - x * w),
        s * (x * z - y * w),
        s * (y * z + x * w),
        1 - s * (x * x + y * y),
    ]
}
