//! By-products of a backward pass, for density control and pruning.

/// Statistics of one Gaussian from a backward pass beside its gradient, summed over the views and over as many passes
/// as it is given to.
///
/// A Gaussian is seen by a view if it adds to at least one pixel of its drawing.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct GaussianStatistics<T> {
    /// Sum over the views of the length of the gradient with respect to the projected mean, per pixel: 3D Gaussian
    /// splatting splits by it (Kerbl et al., 2023, section 5.2).
    pub screen_gradient: T,
    /// Sum over the views of the length of (sum |dL/dx|, sum |dL/dy|), absolute values of the pixels' contributions to
    /// the gradient with respect to the projected mean (x, y): large where a Gaussian is pulled apart, although the
    /// plain gradient may cancel (Ye et al., AbsGS, 2024).
    pub absgrad: T,
    /// Number of views that saw it.
    pub views: u32,
    /// Largest radius among the views that saw it, in pixels: three standard deviations of the longest axis on the
    /// image, the low-pass filter included.
    pub radius: T,
    /// Sum of its blending weights alpha T over all pixels.
    pub contribution: T,
    /// Its largest blending weight at a pixel.
    pub largest_weight: T,
}
