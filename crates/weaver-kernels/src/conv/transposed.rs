//! Transposed convolution without padding: the adjoint of a convolution, with its own name because
//! networks use it to enlarge maps.

use super::{Conv2d, conv2d_dw, conv2d_dx, conv2d_dx_scratch_len, correlate};
use crate::Real;
use crate::parallel::for_chunks;
use crate::target::Target;

/// Length of the scratch that [`conv_transpose2d_forward`] wants.
pub fn conv_transpose2d_scratch_len(size: &Conv2d) -> usize {
    conv2d_dx_scratch_len(size)
}

/// y = transpose of the convolution `size`, plus b:
/// `y[n, c, i stride + p - pad, j stride + q - pad] += w[o, c, p, q] x[n, o, i, j]`.
///
/// The sizes are those of the convolution that this one transposes: `x` is `[n, o, out_h, out_w]`, `w`
/// `[o, c, kh, kw]`, `b` `[c]` and `y` `[n, c, h, w]`. So to enlarge `I` channels of `H x W` to `O`
/// channels with a kernel and stride of 2, `c = O`, `o = I`, `h = 2 H`, `w = 2 W`.
/// `scratch` has [`conv_transpose2d_scratch_len`] elements with any content.
pub fn conv_transpose2d_forward<T: Real>(
    size: &Conv2d,
    x: &[T],
    w: &[T],
    b: Option<&[T]>,
    y: &mut [T],
    scratch: &mut [T],
) {
    let beta = match b {
        Some(b) => {
            assert_eq!(b.len(), size.c, "conv_transpose2d: bias length of {size:?}");
            for_chunks(y, size.h * size.w, |plane, y| y.fill(b[plane % size.c]));
            T::ONE
        }
        None => T::ZERO,
    };
    conv2d_dx(size, w, x, (y, beta), scratch);
}

/// Gradient with respect to the input: `dy` `[n, c, h, w]`, `dx` `[n, o, out_h, out_w]`.
pub fn conv_transpose2d_dx<T: Real>(size: &Conv2d, w: &[T], dy: &[T], dx: Target<T>) {
    correlate(size, dy, w, dx);
}

/// Gradient with respect to the weights `[o, c, kh, kw]`: `x` `[n, o, out_h, out_w]`, `dy` `[n, c, h, w]`.
/// `scratch` has [`conv2d_dw_scratch_len`](super::conv2d_dw_scratch_len) elements with any content.
pub fn conv_transpose2d_dw<T: Real>(size: &Conv2d, x: &[T], dy: &[T], dw: Target<T>, scratch: &mut [T]) {
    conv2d_dw(size, dy, x, dw, scratch);
}
