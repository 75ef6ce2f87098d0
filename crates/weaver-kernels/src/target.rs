//! Where a gradient goes.

use crate::Real;

/// Memory for a gradient and the factor, 0 or 1, for what is in it already. With 0 the memory is
/// overwritten without being read, so it needs no clearing.
pub type Target<'a, T> = (&'a mut [T], T);

/// out = beta out + x, without reading `out` if beta is 0.
#[inline(always)]
pub(crate) fn put<T: Real>(out: &mut T, beta: T, x: T) {
    *out = if beta == T::ZERO { x } else { beta * *out + x };
}
