//! Output slices that are overwritten or accumulated into.

use crate::Real;

/// An output slice and the factor `beta`, 0 or 1, of its present contents: the kernel computes `out = beta out +
/// result`.
///
/// With `beta` 0 the slice is overwritten without being read, so it need not be cleared first. With `beta` 1 the result
/// is added, as when several uses of one variable contribute to its gradient.
pub type Target<'a, T> = (&'a mut [T], T);

/// out = beta out + x, without reading `out` if beta is 0.
#[inline(always)]
pub(crate) fn put<T: Real>(out: &mut T, beta: T, x: T) {
    *out = if beta == T::ZERO { x } else { beta * *out + x };
}
