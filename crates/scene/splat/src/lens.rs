//! Gaussians through lenses of any kind: each on the plane that touches the unit sphere at its own direction, evaluated
//! along the rays of the pixels.
//!
//! The pinhole approximation linearizes the projection on the one image plane, which is wrong far from the axis and
//! impossible beyond 90 degrees. Here every Gaussian has the image plane of a pinhole that looks straight at it. A ray
//! w meets the plane of the direction d at (a, b) = (e1 . w, e2 . w) / (d . w), for e1 and e2 across d. On the axis of
//! a pinhole this is the EWA splat. Only the rays of the pixels and the variance of the blur depend on the lens.

mod cones;
mod gaussian;
mod project;
mod project_backward;
mod rays;

pub(crate) use gaussian::{RayGaussian, factor_in_pixels};
pub(crate) use project::RayProjection;
pub(crate) use rays::{Rays, RaysCache};
