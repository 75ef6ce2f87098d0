//! From accumulated to expected depth.

use weaver_kernels::{Real, parallel};

/// Alpha is not divided by less than this.
pub(crate) const LEAST_ALPHA: f64 = 1e-10;

/// The expected depth: `depth / max(alpha, 1e-10)`, pixel by pixel, in world units.
///
/// `depth` and `alpha` are outputs of [`rasterize`](crate::rasterize()). The gradient is [`expected_depth_backward`]'s.
///
/// # Panics
///
/// If the lengths differ.
///
/// ```
/// let mut expected = [0.0; 2];
/// weaver_splat::expected_depth(&[1.5, 0.0], &[0.5, 0.0], &mut expected);
/// assert_eq!(expected, [3.0, 0.0]);
/// ```
pub fn expected_depth<T: Real>(depth: &[T], alpha: &[T], out: &mut [T]) {
    assert!(depth.len() == out.len() && alpha.len() == out.len(), "expected_depth: images of unequal sizes");
    let least = T::from_f64(LEAST_ALPHA);
    parallel::for_chunks(out, 1 << 14, |chunk, out| {
        let at = chunk << 14;
        for (out, (depth, alpha)) in out.iter_mut().zip(depth[at..].iter().zip(&alpha[at..])) {
            *out = *depth / alpha.max(least);
        }
    });
}

/// Adds the gradients of `depth` and `alpha` from the gradient d of [`expected_depth`]: d / a and -D d / a^2, the
/// latter only where a = alpha is above 1e-10.
///
/// # Panics
///
/// If the lengths differ.
pub fn expected_depth_backward<T: Real>(depth: &[T], alpha: &[T], dout: &[T], ddepth: &mut [T], dalpha: &mut [T]) {
    let lengths = [alpha.len(), dout.len(), ddepth.len(), dalpha.len()];
    assert!(lengths == [depth.len(); 4], "expected_depth_backward: images of unequal sizes");
    let least = T::from_f64(LEAST_ALPHA);
    parallel::for_chunks2(ddepth, 1 << 14, dalpha, 1 << 14, |chunk, ddepth, dalpha| {
        let at = chunk << 14;
        for (i, (ddepth, dalpha)) in ddepth.iter_mut().zip(dalpha).enumerate() {
            let divided = dout[at + i] / alpha[at + i].max(least);
            *ddepth += divided;
            if alpha[at + i] > least {
                *dalpha += -divided * depth[at + i] / alpha[at + i];
            }
        }
    });
}
