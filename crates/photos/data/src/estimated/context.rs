//! Cameras of some views of a scene, estimated from their photos.

use crate::{Scene, SparsePoints};
use weaver_geometry::Camera;
use weaver_sfm::{Confidence, EstimateOptions, Photo, estimate};

/// Views with estimated cameras, and the points that came with these.
#[derive(Clone, Debug, PartialEq)]
pub struct EstimatedContext {
    /// The views that have a camera, by their place in the requested list.
    pub placed: Vec<usize>,
    /// Their cameras, for photos of `size`; the first is the origin.
    pub cameras: Vec<Camera>,
    /// The points, in the frame and in the units of the cameras.
    pub points: SparsePoints,
    /// Confidence in the cameras.
    pub confidence: Confidence,
}

impl Scene {
    /// Estimates the cameras of some views from their photos alone, for photos of `size` (height, width) that show the
    /// same.
    ///
    /// `focal_known` says whether the views' focal lengths are given, as by EXIF. `None` where fewer than two views get
    /// a camera.
    ///
    /// # Panics
    /// If a view is out of range.
    ///
    /// ```
    /// use weaver_data::procedural::{ProceduralOptions, scene};
    ///
    /// let scene = scene(3, &ProceduralOptions { width: 96, height: 72, views: 8 });
    /// let found = scene.estimated_context(&[0, 1, 2, 3], [36, 48], true).expect("views that overlap");
    /// assert_eq!(found.cameras.len(), found.placed.len());
    /// assert_eq!((found.cameras[0].width, found.points.visible.len()), (48, found.placed.len()));
    /// ```
    pub fn estimated_context(
        &self,
        views: &[usize],
        [height, width]: [usize; 2],
        focal_known: bool,
    ) -> Option<EstimatedContext> {
        let photo = |view: &usize| {
            let view = &self.views[*view];
            let photo = Photo::new(view.image.to_bytes(), [view.image.height, view.image.width]);
            Photo { focal: focal_known.then_some(view.camera.intrinsics.fx), ..photo }
        };
        let photos: Vec<Photo<'_>> = views.iter().map(photo).collect();
        let settings = EstimateOptions { focal_deviation: 0.0, ..EstimateOptions::default() };
        let found = estimate(&photos, &settings);
        let resized = |camera: &Camera| {
            let (sx, sy) = (width as f64 / camera.width as f64, height as f64 / camera.height as f64);
            Camera { intrinsics: camera.intrinsics.resized(sx, sy), width, height, ..*camera }
        };
        let placed: Vec<usize> = (0..views.len()).filter(|i| found.cameras[*i].is_ok()).collect();
        let mut visible = vec![Vec::new(); placed.len()];
        for o in &found.observations {
            if let Some(place) = placed.iter().position(|view| *view == o.camera) {
                visible[place].push(o.point as u32);
            }
        }
        let cameras = found.cameras.iter().flatten().map(resized).collect();
        let points = SparsePoints { positions: found.points.clone(), visible };
        (placed.len() > 1).then(|| EstimatedContext { placed, cameras, points, confidence: found.confidence() })
    }
}
