//! Views and how well they were met.

use weaver_fit::Quality;
use weaver_geometry::Camera;

/// A view that was judged.
pub(crate) struct Judged {
    pub name: String,
    /// Its number among the fitted photos, or among the held-out ones.
    pub number: usize,
    pub camera: Camera,
    /// The render, where the report shows it: all views would take more memory than the scene.
    pub image: Option<Vec<f32>>,
    pub quality: Quality,
}
