//! Depth of photos whose cameras are known, from the photos alone, and Gaussians on the surface that they agree about.
//!
//! Each pixel looks for the plane under which its surroundings look alike in neighboring photos: planes are drawn at
//! random and handed on from pixel to pixel. Depth is kept where two other photos, each on its own, show the same;
//! small patches need a third.
//!
//! ```
//! use weaver_scene::{Photo, PointCloud};
//! use weaver_stereo::{Stereo, StereoSettings};
//! // Without photos there is nothing to agree about.
//! let stereo = Stereo::of::<Photo>(&[], &PointCloud::default(), &[], &StereoSettings::default());
//! assert!(stereo.surface().gaussians(100).means.is_empty());
//! ```
//!
//! Sources: Bleyer, Rhemann and Rother, PatchMatch stereo: stereo matching with slanted support windows, 2011, for
//! planes and their propagation; Schönberger, Zheng, Frahm and Pollefeys, Pixelwise view selection for unstructured
//! multi-view stereo, 2016, for bilateral weights and the geometric term; Xu and Tao, Multi-scale geometric consistency
//! guided multi-view stereo, 2019, for the chessboard.

mod agreement;
mod cells;
mod depth;
mod patch;
mod picture;
mod search;
mod sources;
mod speckles;
mod surface;
mod warp;

pub use depth::{Stereo, StereoSettings};
pub use sources::best_photos;
pub use surface::Surface;

/// The example of the README, compiled and run.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
