//! Conversion between fields of view and focal lengths, generic over the number type.

use std::ops::{Add, Div, Mul};

/// The focal length of a field of view, in pixels: `f = (size / 2) / (tan(fov / 2) + tangent_offset)`.
///
/// `fov` is the full angle in radians over an image of `size` pixels. `X` is a float or a dual number, and
/// `tan` its tangent. With `tangent_offset` 0 this inverts [`field_of_view`].
pub fn focal_length<X>(fov: X, size: f64, tangent_offset: f64, tan: impl Fn(X) -> X) -> X
where
    X: From<f64> + Add<Output = X> + Mul<Output = X> + Div<Output = X>,
{
    X::from(0.5 * size) / (tan(X::from(0.5) * fov) + X::from(tangent_offset))
}

/// The field of view of a focal length, a full angle in radians: `fov = 2 atan(size / 2 / f)`.
///
/// `focal` is in pixels of an image of `size` pixels. `X` is a float or a dual number, and `atan` its arc tangent.
pub fn field_of_view<X>(focal: X, size: f64, atan: impl Fn(X) -> X) -> X
where
    X: From<f64> + Mul<Output = X> + Div<Output = X>,
{
    X::from(2.0) * atan(X::from(0.5 * size) / focal)
}
