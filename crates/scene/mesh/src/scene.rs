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
/// The range of a pixel is D / (A cos), for the blended depth D = sum of w z, the alpha A, and the angle between its
/// ray and the optical axis; 0 where A < 1/2, and beyond `far`. Its color comes from the drawn image without the
/// background.
#[derive(Debug)]
pub struct DrawnScene {
    gaussians: ActivatedGaussians,
    background: [f32; 3],
    settings: RasterSettings,
    far: f64,
    carving: bool,
    session: Box<dyn Session<f32>>,
    views: Vec<DrawnView>,
}

#[derive(Debug)]
struct DrawnView {
    camera: SurfelCamera,
    pose: Pose,
    /// `[H, W]`.
    range: Vec<f32>,
    /// `[H, W]`.
    color: Vec<[u8; 3]>,
}

impl DrawnScene {
    /// A scene that no camera has seen yet.
    pub fn new(gaussians: &Gaussians, background: [f32; 3], settings: RasterSettings, far: f64) -> Self {
        let (gaussians, session) = (gaussians.to_activated(), CpuRasterizer.session());
        Self { gaussians, background, settings, far, carving: false, session, views: Vec::new() }
    }

    /// The same with pixels that see nothing as well: their range is infinite, which leaves nothing on their way. Their
    /// neighbors, at the edge of something half transparent, get no range.
    #[must_use]
    pub fn carving(self) -> Self {
        Self { carving: true, ..self }
    }

    /// Draws the scene from one camera more.
    ///
    /// # Errors
    /// If the rasterizer refuses to draw it.
    pub fn add(&mut self, camera: &Camera) -> Result<(), RasterError> {
        let pixels = camera.width * camera.height;
        let (mut image, mut alpha, mut depth) = (vec![0.0; 3 * pixels], vec![0.0; pixels], vec![0.0; pixels]);
        let rows = CameraRows::new(&[*camera]);
        let images = Images { image: &mut image, alpha: &mut alpha, depth: Some(&mut depth), features: None };
        let cameras = rows.as_slices(&self.background);
        self.session.forward(&self.gaussians.as_slices(), &cameras, &self.settings, images)?;
        let lens = SurfelCamera { lens: Lens::Pinhole(camera.intrinsics), width: camera.width, height: camera.height };
        let (far, background) = (self.far, self.background);
        let nothing = if self.carving { f32::INFINITY } else { 0.0 };
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
        if self.carving {
            let edges: Vec<bool> = (0..pixels).into_par_iter().map(|pixel| is_edge(&lens, &range, pixel)).collect();
            range.iter_mut().zip(edges).filter(|(_, edge)| *edge).for_each(|(range, _)| *range = 0.0);
        }
        self.views.push(DrawnView { camera: lens, pose: camera.pose, range, color });
        Ok(())
    }

    /// The range images.
    pub fn views(&self) -> Vec<RangeView<'_>> {
        self.views.iter().map(DrawnView::ranges).collect()
    }

    /// Colors of points: means over the views that see a surface within `reach` of the point, by the inverse square of
    /// its distance; gray where none does.
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

/// True if a pixel sees something, and one of its four neighbors does not.
fn is_edge(camera: &SurfelCamera, range: &[f32], pixel: usize) -> bool {
    let (column, row) = (pixel % camera.width, pixel / camera.width);
    let sees = |inside: bool, by: isize| !inside || range[pixel.wrapping_add_signed(by)].is_finite();
    let (one, line) = (1, camera.width as isize);
    let all = sees(column > 0, -one) && sees(column + 1 < camera.width, one);
    range[pixel].is_finite() && !(all && sees(row > 0, -line) && sees(row + 1 < camera.height, line))
}

impl DrawnView {
    fn ranges(&self) -> RangeView<'_> {
        RangeView { camera: &self.camera, pose: self.pose, range: &self.range, normal: &[] }
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
