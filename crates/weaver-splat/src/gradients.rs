//! Where gradients come from and where they go.

use crate::statistics::GaussianStatistics;
use weaver_kernels::Real;

/// Gradients that arrive at the images; `None` is zero.
#[derive(Clone, Copy, Debug)]
pub struct Cotangents<'a, T> {
    /// `[V, H, W, 3]`
    pub image: Option<&'a [T]>,
    /// `[V, H, W]`
    pub alpha: Option<&'a [T]>,
    /// `[V, H, W]`; only where depth was drawn.
    pub depth: Option<&'a [T]>,
    /// `[V, H, W, C]`
    pub features: Option<&'a [T]>,
}

impl<T> Default for Cotangents<'_, T> {
    fn default() -> Self {
        Self { image: None, alpha: None, depth: None, features: None }
    }
}

/// Memory for a gradient, and whether to add to what is in it.
#[derive(Debug)]
pub struct Target<'a, T> {
    /// The memory.
    pub values: &'a mut [T],
    /// Whether the gradient is added to what is there; else it replaces it.
    pub add: bool,
}

impl<'a, T: Real> Target<'a, T> {
    /// The gradient replaces what is there.
    pub fn write(values: &'a mut [T]) -> Self {
        Self { values, add: false }
    }

    /// The gradient is added to what is there.
    pub fn add(values: &'a mut [T]) -> Self {
        Self { values, add: true }
    }

    /// Writes, or adds to, one number; 0 for what is not finite.
    pub(crate) fn put(&mut self, at: usize, value: T) {
        put(&mut self.values[at], self.add, value);
    }

    /// The first `at` numbers, and the rest.
    pub(crate) fn split(self, at: usize) -> (Self, Self) {
        let (a, b) = self.values.split_at_mut(at);
        (Self { values: a, add: self.add }, Self { values: b, add: self.add })
    }
}

/// Writes a number, or adds it; 0 for what is not finite.
#[inline(always)]
pub(crate) fn put<T: Real>(to: &mut T, add: bool, value: T) {
    let old = if add { *to } else { T::ZERO };
    *to = old + if value.is_finite() { value } else { T::ZERO };
}

/// Where gradients go; `None` where nobody asks.
#[derive(Debug)]
pub struct Gradients<'a, T> {
    /// `[N, 3]`
    pub means: Option<Target<'a, T>>,
    /// `[N, 4]`
    pub quats: Option<Target<'a, T>>,
    /// `[N, 3]`
    pub scales: Option<Target<'a, T>>,
    /// `[N]`
    pub opacities: Option<Target<'a, T>>,
    /// `[N, 3]` or `[N, K, 3]`
    pub colors: Option<Target<'a, T>>,
    /// `[N, C]`
    pub features: Option<Target<'a, T>>,
    /// `[V, 3, 4]` or `[V, 4, 4]`, as given; the last row of the latter is zero.
    pub viewmats: Option<Target<'a, T>>,
    /// `[V, 4]`
    pub intrinsics: Option<Target<'a, T>>,
    /// `[V, 3]` or `[3]`, as given.
    pub background: Option<Target<'a, T>>,
    /// Not gradients but by-products, which the pass adds to, `[N]`.
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
