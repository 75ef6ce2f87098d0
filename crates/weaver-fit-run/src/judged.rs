//! Views and how well they were met.

use weaver_fit::Quality;
use weaver_geometry::Camera;

/// A view that was judged.
pub(crate) struct Judged {
    pub name: String,
    pub camera: Camera,
    pub image: Vec<f32>,
    pub quality: Quality,
}
