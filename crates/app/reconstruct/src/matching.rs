//! Cameras that are refined by matching photos, before anything is fitted.

use weaver_geometry::Camera;
use weaver_geometry::glam::DVec3;
use weaver_scene::{Photo, PointCloud};
use weaver_sfm::{RefineSettings, Refined, View, carried, refine};

/// Agreement of photos about points.
#[derive(Clone, Copy, Debug)]
pub struct Matching {
    /// Points.
    pub points: usize,
    /// Median difference of where points are and were seen, pixels; not a number if there are none.
    pub pixels: f64,
    /// Factor on focal lengths.
    pub focal: f64,
}

impl Matching {
    /// Refines the cameras of training photos, and locates held-out photos by points that the training photos agree
    /// about. Points move with the cameras that see them, and the found points join them.
    pub fn refine(training: &mut [Photo], held_out: &mut [Photo], points: &mut PointCloud, refine_focal: bool) -> Self {
        let views: Vec<View<'_>> =
            (training.iter().map(|p| view(p, false))).chain(held_out.iter().map(|p| view(p, true))).collect();
        let found = refine(&views, &RefineSettings { focal: refine_focal, ..RefineSettings::default() });
        drop(views);
        let given: Vec<Camera> = training.iter().map(|p| p.camera).collect();
        let focal = found.cameras[0].intrinsics.fx / given[0].intrinsics.fx;
        let photos = training.iter_mut().chain(held_out);
        photos.zip(&found.cameras).for_each(|(photo, camera)| photo.camera = *camera);
        for position in &mut points.positions {
            *position = carried(DVec3::from(position.map(f64::from)), &given, &found.cameras[..given.len()])
                .as_vec3()
                .to_array();
        }
        add_found(points, &found, training);
        Self { points: found.points.len(), pixels: found.error, focal }
    }
}

fn view(photo: &Photo, located: bool) -> View<'_> {
    View { located, ..View::new(photo.camera, &photo.rgb, photo.mask.as_deref()) }
}

/// Adds points that photos agree about, in the color of the first photo that sees them.
fn add_found(points: &mut PointCloud, found: &Refined, training: &[Photo]) {
    let mut colors: Vec<Option<[u8; 3]>> = vec![None; found.points.len()];
    for o in &found.observations {
        if let (None, Some(photo)) = (colors[o.point], training.get(o.camera)) {
            let Camera { width, height, .. } = photo.camera;
            let (x, y) = ((o.pixel.x as usize).min(width - 1), (o.pixel.y as usize).min(height - 1));
            let at = 3 * (y * width + x);
            colors[o.point] = Some(std::array::from_fn(|c| photo.rgb[at + c]));
        }
    }
    for (point, color) in found.points.iter().zip(colors) {
        if let Some(color) = color {
            points.positions.push(point.as_vec3().to_array());
            points.colors.push(color);
        }
    }
}
