//! Which points bundle adjustment looks at, and from where.

use super::{Cameras, Picture};
use weaver_geometry::glam::DVec2;

/// Where a patch around a point is looked at.
pub(super) const PATCH: [[f64; 2]; 9] =
    [[0.0, 0.0], [-2.0, 0.0], [2.0, 0.0], [0.0, -2.0], [0.0, 2.0], [-1.0, -1.0], [1.0, -1.0], [-1.0, 1.0], [1.0, 1.0]];
/// Points of a picture, at most: one in each cell of a grid.
const POINTS: f64 = 400.0;
/// Other cameras that look at a point, at most.
const VIEWS: usize = 12;
/// Depths that differ by no more than this part are taken for the same surface.
const SAME: f64 = 0.1;
/// Part that depths of a patch differ by, at most.
const FLAT: f64 = 0.03;
/// Cosine of the largest angle between two views of a point.
const ANGLE: f64 = 0.6;
/// Square of the least slope, per pixel, of what is looked at.
const TEXTURE: f32 = 1e-4;

/// A point that is seen at a pixel of one picture, at a depth to be found, and that other cameras see too.
#[derive(Clone, Debug)]
pub(super) struct Point {
    /// The picture that it was chosen in.
    pub anchor: usize,
    pub pixel: DVec2,
    pub depth: f64,
    pub views: Vec<usize>,
}

/// The pixel with the steepest slope of each cell of each picture, if enough is to be seen there.
pub(super) fn choose(pictures: &[Picture<'_>], cameras: &Cameras) -> Vec<Point> {
    let mut points = Vec::new();
    for (anchor, picture) in pictures.iter().enumerate() {
        let (width, height) = (picture.camera.width, picture.camera.height);
        let cell = ((width * height) as f64 / POINTS).sqrt().ceil().max(2.0) as usize;
        for top in (2..height.saturating_sub(cell)).step_by(cell) {
            for left in (2..width.saturating_sub(cell)).step_by(cell) {
                let pixels = (0..cell * cell).map(|i| (top + i / cell) * width + left + i % cell);
                let best = pixels.max_by(|a, b| picture.texture(*a).total_cmp(&picture.texture(*b)));
                let Some(at) = best.filter(|at| picture.texture(*at) > TEXTURE) else { continue };
                let pixel = DVec2::new((at % width) as f64 + 0.5, (at / width) as f64 + 0.5);
                let Some(depth) = picture.depth_at(pixel) else { continue };
                // Where depth jumps, a patch is of two surfaces.
                let near = |o: &[f64; 2]| {
                    picture.depth_at(pixel + DVec2::from(*o)).is_some_and(|z| (z / depth).ln().abs() < FLAT)
                };
                if !PATCH.iter().all(near) {
                    continue;
                }
                let views = views(pictures, cameras, anchor, pixel, depth);
                if !views.is_empty() {
                    points.push(Point { anchor, pixel, depth, views });
                }
            }
        }
    }
    points
}

/// The other cameras that see the point at a pixel; of too many some, evenly.
fn views(pictures: &[Picture<'_>], cameras: &Cameras, anchor: usize, pixel: DVec2, depth: f64) -> Vec<usize> {
    let local = pictures[anchor].camera.intrinsics.unproject(pixel, depth);
    let point = cameras.poses[anchor].inverse().apply(local);
    let from = (point - cameras.poses[anchor].center()).normalize_or_zero();
    let sees = |view: &usize| {
        let (picture, pose) = (&pictures[*view], &cameras.poses[*view]);
        let seen = pose.apply(point);
        let near = from.dot((point - pose.center()).normalize_or_zero()) > ANGLE && seen.z > 0.0;
        let surface = || picture.depth_at(picture.camera.intrinsics.project(seen));
        *view != anchor && near && surface().is_some_and(|z| (z / seen.z).ln().abs() < SAME)
    };
    let all: Vec<usize> = (0..pictures.len()).filter(sees).collect();
    let taken = all.len().min(VIEWS);
    (0..taken).map(|i| all[i * all.len() / taken]).collect()
}
