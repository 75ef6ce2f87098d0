//! Gaussians as a rasterizer takes them.

use weaver_geometry::sh;

/// Gaussians in activated form, borrowed as a structure of arrays. `N` is the number of Gaussians.
#[derive(Clone, Copy, Debug)]
pub struct GaussianSlices<'a, T> {
    /// Centers in world units, `[N, 3]`.
    pub means: &'a [T],
    /// Rotations from the Gaussian's axes to the world's, quaternions wxyz, of any length but zero, `[N, 4]`.
    pub quats: &'a [T],
    /// Standard deviations along the Gaussian's axes in world units (not their logarithms), `[N, 3]`.
    pub scales: &'a [T],
    /// Opacities in `[0, 1]` (not their logits), `[N]`.
    pub opacities: &'a [T],
    /// Colors.
    pub color: Color<'a, T>,
    /// Further numbers to blend, if any.
    pub features: Option<Features<'a, T>>,
    /// The picture of each Gaussian, where a view is several pictures.
    pub groups: Option<Groups<'a>>,
}

/// Gaussians in groups that do not see each other: a view of K groups is K pictures, each drawn as if its Gaussians
/// were alone.
#[derive(Clone, Copy, Debug)]
pub struct Groups<'a> {
    /// The group of each Gaussian, 0 to K - 1, `[N]`.
    pub of: &'a [u32],
    /// K, at least 1.
    pub count: usize,
}

/// Numbers of any meaning that are blended as colors are, over a background of zeros.
#[derive(Clone, Copy, Debug)]
pub struct Features<'a, T> {
    /// `[N, C]`
    pub values: &'a [T],
    /// C.
    pub channels: usize,
}

impl<'a, T> Features<'a, T> {
    /// The features of Gaussian `n`, `[C]`.
    #[inline(always)]
    pub fn of(&self, n: usize) -> &'a [T] {
        &self.values[n * self.channels..][..self.channels]
    }
}

/// The colors of Gaussians.
#[derive(Clone, Copy, Debug)]
pub enum Color<'a, T> {
    /// None: there is no image, only alpha and the other requested outputs.
    None,
    /// One color per Gaussian, the same from all sides, `[N, 3]`, not clamped.
    Plain(&'a [T]),
    /// Spherical harmonics in world axes, `[N, K, 3]` with K = (degree + 1)^2; the color seen along the direction
    /// from the camera center to the mean is `max(sum of basis times coefficient + 0.5, 0)`.
    Sh {
        /// `[N, K, 3]`.
        coefficients: &'a [T],
        /// 0 to 4.
        degree: usize,
    },
}

impl<'a, T> Color<'a, T> {
    /// All numbers, and how many of them belong to one Gaussian.
    pub fn values(&self) -> (&'a [T], usize) {
        match *self {
            Color::None => (&[], 0),
            Color::Plain(values) => (values, 3),
            Color::Sh { coefficients, degree } => (coefficients, 3 * sh::coefficients(degree)),
        }
    }
}
