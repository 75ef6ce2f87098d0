//! Scenes of Gaussians as range images.

use crate::RangeView;
use rayon::prelude::*;
use weaver_geometry::glam::DVec3;
use weaver_geometry::{Camera, Pose};
use weaver_scene::{ActivatedGaussians, CameraRows, Gaussians};
use weaver_splat::{CpuRasterizer, Images, RasterError, RasterSettings, Rasterizer, Session};
use weaver_surfel::{Lens, SurfelCamera};

/// Alpha below which nothing is there.
const OPAQUE: f32 = 0.5;
/// Color of points that no view sees.
const UNSEEN: [u8; 3] = [128; 3];

/// Ranges and colors of a scene's surface, as its cameras see it.
///
/// The range of a pixel is D / (A cos), for the blended depth D = sum of w z, the alpha A, and the angle between its ray and the optical axis;
/// 0 where A < 1/2, and beyond `far`. Its color is that of the drawn image without the background.
#[derive(Debug)]
pub struct DrawnScene {
    gaussians: ActivatedGaussians,
    background: [f32; 3],
    settings: RasterSettings,
    far: f64,
    normals: bool,
    session: Box<dyn Session<f32>>,
    views: Vec<DrawnView>,
}

#[derive(Debug)]
struct DrawnView {
    camera: SurfelCamera,
    pose: Pose,
    /// `[H, W]`.
    range: Vec<f32>,
    /// `[H, W, 3]`, or empty.
    normals: Vec<f32>,
    /// `[H, W]`.
    color: Vec<[u8; 3]>,
}

impl DrawnScene {
    /// A scene of which no camera has seen anything yet.
    pub fn new(gaussians: &Gaussians, background: [f32; 3], settings: RasterSettings, far: f64) -> Self {
        let (gaussians, session) = (gaussians.to_activated(), CpuRasterizer.session());
        Self { gaussians, background, settings, far, normals: false, session, views: Vec::new() }
    }

    /// The same with normals, those of the points that a pixel's four neighbors see. A pixel that lacks one of them gets no range: it is at the
    /// edge of something half transparent. One that sees nothing has an infinite range, which leaves nothing on its way.
    #[must_use]
    pub fn with_normals(self) -> Self {
        Self { normals: true, ..self }
    }

    /// Draws the scene from one camera more.
    ///
    /// # Errors
    /// Where the rasterizer refuses to draw it.
    pub fn add(&mut self, camera: &Camera) -> Result<(), RasterError> {
        let pixels = camera.width * camera.height;
        let (mut image, mut alpha, mut depth) = (vec![0.0; 3 * pixels], vec![0.0; pixels], vec![0.0; pixels]);
        let rows = CameraRows::new(&[*camera]);
        let images = Images { image: &mut image, alpha: &mut alpha, depth: Some(&mut depth), features: None };
        let cameras = rows.as_slices(&self.background);
        self.session.forward(&self.gaussians.as_slices(), &cameras, &self.settings, images)?;
        let lens = SurfelCamera { lens: Lens::Pinhole(camera.intrinsics), width: camera.width, height: camera.height };
        let (far, background) = (self.far, self.background);
        let nothing = if self.normals { f32::INFINITY } else { 0.0 };
        let range = |pixel: usize| {
            if alpha[pixel] < OPAQUE {
                return nothing;
            }
            let ray = lens.pixel_ray(pixel % camera.width, pixel / camera.width);
            let range = f64::from(depth[pixel] / alpha[pixel]) / ray.z;
            if range < far { range as f32 } else { nothing }
        };
        let color = |pixel: usize| {
            [0, 1, 2].map(|c| {
                let alone = image[3 * pixel + c] - (1.0 - alpha[pixel]) * background[c];
                (255.0 * (alone / alpha[pixel].max(OPAQUE)).clamp(0.0, 1.0)).round() as u8
            })
        };
        let mut range: Vec<f32> = (0..pixels).into_par_iter().map(range).collect();
        let color = (0..pixels).into_par_iter().map(color).collect();
        let mut normals = Vec::new();
        if self.normals {
            let found: Vec<_> = (0..pixels).into_par_iter().map(|pixel| normal(&lens, &range, pixel)).collect();
            let edges = range.iter_mut().zip(&found).filter(|(range, normal)| range.is_finite() && normal.is_none());
            edges.for_each(|(range, _)| *range = 0.0);
            normals = found.into_iter().flat_map(Option::unwrap_or_default).collect();
        }
        self.views.push(DrawnView { camera: lens, pose: camera.pose, range, normals, color });
        Ok(())
    }

    /// The range images.
    pub fn views(&self) -> Vec<RangeView<'_>> {
        self.views.iter().map(DrawnView::ranges).collect()
    }

    /// Colors of points: means over the views that see a surface within `reach` of the point, by the inverse square of its distance; gray
    /// where none does.
    pub fn colors(&self, points: &[[f32; 3]], reach: f64) -> Vec<[u8; 3]> {
        let views = &self.views;
        let color = |point: &[f32; 3]| {
            let point = DVec3::from_array(point.map(f64::from));
            let (mut sum, mut weights) = (DVec3::ZERO, 0.0);
            for (color, distance) in views.iter().filter_map(|view| view.sees(point, reach)) {
                let weight = 1.0 / (distance * distance);
                sum += weight * DVec3::from_array(color.map(f64::from));
                weights += weight;
            }
            if weights > 0.0 { (sum / weights).to_array().map(|x| x.round() as u8) } else { UNSEEN }
        };
        points.par_iter().map(color).collect()
    }
}

/// The direction across the points of a pixel's four neighbors, in the camera's frame; none where one of them is not seen.
fn normal(camera: &SurfelCamera, range: &[f32], pixel: usize) -> Option<[f32; 3]> {
    let (column, row) = (pixel % camera.width, pixel / camera.width);
    if column == 0 || row == 0 || column + 1 == camera.width || row + 1 == camera.height {
        return None;
    }
    let point = |column: usize, row: usize| {
        let range = range[row * camera.width + column];
        range.is_finite().then(|| camera.pixel_ray(column, row) * f64::from(range))
    };
    let across = point(column + 1, row)? - point(column - 1, row)?;
    let down = point(column, row + 1)? - point(column, row - 1)?;
    point(column, row)?;
    Some(across.cross(down).normalize_or_zero().to_array().map(|x| x as f32))
}

impl DrawnView {
    fn ranges(&self) -> RangeView<'_> {
        RangeView { camera: &self.camera, pose: self.pose, range: &self.range, normal: &self.normals }
    }

    /// The color of a point and its distance, if the view sees a surface within `reach` of it.
    fn sees(&self, point: DVec3, reach: f64) -> Option<([u8; 3], f64)> {
        let p = self.pose.apply(point);
        let at = self.camera.project(p);
        let inside = at.x >= 0.0 && at.y >= 0.0 && at.x < self.camera.width as f64 && at.y < self.camera.height as f64;
        let pixel = inside.then_some(at.y as usize * self.camera.width + at.x as usize)?;
        let distance = p.length();
        ((f64::from(self.range[pixel]) - distance).abs() < reach).then_some((self.color[pixel], distance))
    }
}
