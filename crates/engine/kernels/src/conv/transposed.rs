//! Transposed convolution: the adjoint of a convolution, used by networks to enlarge maps.

use super::{Conv2dShape, conv2d_dw, conv2d_dx, conv2d_dx_scratch_len, correlate};
use crate::Real;
use crate::parallel::for_chunks;
use crate::target::Target;

/// Length of the scratch space of [`conv_transpose2d_forward`].
pub fn conv_transpose2d_scratch_len(shape: &Conv2dShape) -> usize {
    conv2d_dx_scratch_len(shape)
}

/// Transposed convolution with an optional bias.
///
/// `y[n, c, i stride + p - pad, j stride + q - pad] += w[o, c, p, q] x[n, o, i, j]`, starting from `b[c]`.
///
/// `shape` describes the convolution that is transposed, so `x` is `[n, o, out_h, out_w]`, `w` `[o, c, kh, kw]`, `b`
/// `[c]` and `y` `[n, c, h, w]`. For example, to enlarge I channels of H x W to O channels of 2 H x 2 W with a 2 x 2
/// kernel, set `o = I`, `c = O`, `h = 2 H`, `w = 2 W` and `stride = 2`. `scratch` has [`conv_transpose2d_scratch_len`]
/// elements with any content.
///
/// # Panics
///
/// If a length does not fit the shape.
#[inline(never)]
pub fn conv_transpose2d_forward<T: Real>(
    shape: &Conv2dShape,
    x: &[T],
    w: &[T],
    b: Option<&[T]>,
    y: &mut [T],
    scratch: &mut [T],
) {
    let beta = match b {
        Some(b) => {
            assert_eq!(b.len(), shape.c, "conv_transpose2d: bias length of {shape:?}");
            for_chunks(y, shape.h * shape.w, |plane, y| y.fill(b[plane % shape.c]));
            T::ONE
        }
        None => T::ZERO,
    };
    conv2d_dx(shape, w, x, (y, beta), scratch);
}

/// Gradient of [`conv_transpose2d_forward`] with respect to the input: `dy` is `[n, c, h, w]`, `dx` `[n, o, out_h,
/// out_w]`.
#[inline(never)]
pub fn conv_transpose2d_dx<T: Real>(shape: &Conv2dShape, w: &[T], dy: &[T], dx: Target<T>) {
    correlate(shape, dy, w, dx);
}

/// Gradient of [`conv_transpose2d_forward`] with respect to the weights: `x` is `[n, o, out_h, out_w]`, `dy` `[n, c, h,
/// w]`, `dw` `[o, c, kh, kw]`.
///
/// `scratch` has [`conv2d_dw_scratch_len`](super::conv2d_dw_scratch_len) elements with any content.
#[inline(never)]
pub fn conv_transpose2d_dw<T: Real>(shape: &Conv2dShape, x: &[T], dy: &[T], dw: Target<T>, scratch: &mut [T]) {
    conv2d_dw(shape, dy, x, dw, scratch);
}
