//! Rotations from quaternions of any length, for numbers and for lanes of them.

use crate::each::each;
use crate::matrix::{Mat33, Ring};

/// The rotation matrix of a unit quaternion wxyz; `one` is 1.
#[inline(always)]
pub(crate) fn rotation<X: Ring>(one: X, [w, x, y, z]: [X; 4]) -> Mat33<X> {
    let twice = |x: X| x + x;
    [
        [one - twice(y * y + z * z), twice(x * y - w * z), twice(x * z + w * y)],
        [twice(x * y + w * z), one - twice(x * x + z * z), twice(y * z - w * x)],
        [twice(x * z - w * y), twice(y * z + w * x), one - twice(x * x + y * y)],
    ]
}

/// Backward of the rotation matrix of q / |q|, given the unit quaternion and 1 / |q|.
#[inline(always)]
pub(crate) fn rotation_backward<X: Ring>(unit: [X; 4], inverse_length: X, d: &Mat33<X>) -> [X; 4] {
    let twice = |x: X| x + x;
    let [w, x, y, z] = unit;
    let (a, b, c) = (d[2][1] - d[1][2], d[0][2] - d[2][0], d[1][0] - d[0][1]);
    let (f, g, h) = (d[0][1] + d[1][0], d[0][2] + d[2][0], d[1][2] + d[2][1]);
    let dunit = [
        twice(x * a + y * b + z * c),
        twice(w * a + y * f + z * g - twice(x * (d[1][1] + d[2][2]))),
        twice(w * b + x * f + z * h - twice(y * (d[0][0] + d[2][2]))),
        twice(w * c + x * g + y * h - twice(z * (d[0][0] + d[1][1]))),
    ];
    let along = unit[0] * dunit[0] + unit[1] * dunit[1] + unit[2] * dunit[2] + unit[3] * dunit[3];
    each!(4, |i| (dunit[i] - unit[i] * along) * inverse_length)
}
