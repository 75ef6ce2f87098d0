//! Flat Gaussians (surfels) in range images of pinhole and spherical cameras, drawn by exact ray intersection, with
//! gradients.
//!
//! - [`Surfels`] are centers, quaternions, scales and opacities.
//! - A [`SurfelCamera`] has a pinhole or a [`Spherical`] lens; the latter is periodic in azimuth and exact at the
//!   poles.
//! - A [`SurfelWorkspace`] draws ([`draw`](SurfelWorkspace::draw)) range, normals and opacity, and differentiates them
//!   ([`backward`](SurfelWorkspace::backward)); weaver-splat gives tiles, lists, order and sums.
//! - [`mod@reference`] draws the same pixel by pixel, slowly, to test against.
//!
//! A surfel with center c, tangents t1 and t2, normal n, scales s1 and s2 and opacity o, all in the camera's frame,
//! meets the ray d at the range r = n.c / n.d. With a = (r d - c).t1 / s1 and b likewise, its alpha is o exp(-(a^2 +
//! b^2) / 2), or o exp(-(du^2 + dv^2)) for the distance (du, dv) of the pixel from the projected center where that is
//! more, so that no surfel is lost between pixels.

mod camera;
mod chain;
mod draw;
mod limits;
mod record;
pub mod reference;
mod response;
mod surfels;

pub use camera::{Lens, Spherical, SurfelCamera};
pub use draw::{RangeCotangents, RangeImages, SurfelWorkspace};
pub use limits::Limits;
pub use record::Sight;
pub use surfels::{SurfelSlices, Surfels};
pub use weaver_splat::RasterError;

/// The example of the README, compiled and run.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
