//! What every kind of capture comes down to before its photos are read.

use std::path::PathBuf;
use weaver_geometry::Camera;
use weaver_geometry::glam::DVec3;

/// One photo and its camera, at the photo's own size.
#[derive(Clone, Debug)]
pub(super) struct Shot {
    pub name: String,
    pub file: PathBuf,
    pub camera: Camera,
    pub held_out: bool,
    /// Indices of the points it observes, ascending, each once.
    pub track: Vec<u32>,
}

/// The photos and points of a capture.
#[derive(Clone, Debug)]
pub(super) struct Footage {
    pub shots: Vec<Shot>,
    pub points: Vec<DVec3>,
    /// Whether the capture itself says which shots are held out.
    pub split: bool,
}
