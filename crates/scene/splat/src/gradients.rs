//! The gradients that a backward pass is given, and memory for those that it returns.

use crate::statistics::GaussianStatistics;
use weaver_kernels::Real;

/// Gradients of the loss with respect to the images; `None` means zero. `H` and `W` are the sizes of the drawn region.
#[derive(Clone, Copy, Debug)]
pub struct Cotangents<'a, T> {
    /// With respect to the image, `[V, H, W, 3]`.
    pub image: Option<&'a [T]>,
    /// With respect to alpha, `[V, H, W]`.
    pub alpha: Option<&'a [T]>,
    /// With respect to the depth, `[V, H, W]`; only where depth was drawn.
    pub depth: Option<&'a [T]>,
    /// With respect to the image of the features, `[V, H, W, C]`.
    pub features: Option<&'a [T]>,
}

impl<T> Default for Cotangents<'_, T> {
    fn default() -> Self {
        Self { image: None, alpha: None, depth: None, features: None }
    }
}

/// Memory for a gradient, and whether to add to its content.
#[derive(Debug)]
pub struct Target<'a, T> {
    /// The memory.
    pub values: &'a mut [T],
    /// True if the gradient is added to the content; else it replaces it.
    pub add: bool,
}

impl<'a, T: Real> Target<'a, T> {
    /// The gradient replaces the content.
    pub fn write(values: &'a mut [T]) -> Self {
        Self { values, add: false }
    }

    /// The gradient is added to the content.
    pub fn add(values: &'a mut [T]) -> Self {
        Self { values, add: true }
    }

    /// Writes, or adds to, one number; 0 if the value is not finite.
    pub fn put(&mut self, at: usize, value: T) {
        put(&mut self.values[at], self.add, value);
    }

    /// The first `at` numbers, and the rest.
    pub(crate) fn split(self, at: usize) -> (Self, Self) {
        let (a, b) = self.values.split_at_mut(at);
        (Self { values: a, add: self.add }, Self { values: b, add: self.add })
    }
}

/// Writes a number, or adds it; 0 if it is not finite.
#[inline(always)]
pub(crate) fn put<T: Real>(to: &mut T, add: bool, value: T) {
    let old = if add { *to } else { T::ZERO };
    *to = old + if value.is_finite() { value } else { T::ZERO };
}

/// Memory for the gradients with respect to each input; `None` leaves a gradient out.
#[derive(Debug)]
pub struct Gradients<'a, T> {
    /// With respect to the means, `[N, 3]`.
    pub means: Option<Target<'a, T>>,
    /// With respect to the quaternions as given, normalized or not, `[N, 4]`.
    pub quats: Option<Target<'a, T>>,
    /// With respect to the standard deviations, `[N, 3]`.
    pub scales: Option<Target<'a, T>>,
    /// With respect to the opacities, `[N]`.
    pub opacities: Option<Target<'a, T>>,
    /// With respect to the colors, `[N, 3]`, or the coefficients, `[N, K, 3]`.
    pub colors: Option<Target<'a, T>>,
    /// With respect to the features, `[N, C]`.
    pub features: Option<Target<'a, T>>,
    /// With respect to the view matrices, `[V, 3, 4]` or `[V, 4, 4]`, as given; the last row of the latter is zero.
    pub viewmats: Option<Target<'a, T>>,
    /// With respect to fx, fy, cx, cy, `[V, 4]`.
    pub intrinsics: Option<Target<'a, T>>,
    /// With respect to the background, `[V, 3]` or `[3]`, as given.
    pub background: Option<Target<'a, T>>,
    /// By-products of the pass, which are added to the content, `[N]`.
    pub statistics: Option<&'a mut [GaussianStatistics<T>]>,
}

impl<T> Default for Gradients<'_, T> {
    fn default() -> Self {
        Self {
            means: None,
            quats: None,
            scales: None,
            opacities: None,
            colors: None,
            features: None,
            viewmats: None,
            intrinsics: None,
            background: None,
            statistics: None,
        }
    }
}
