//! Visible points of photos.

use super::photo::{Photo, Photos};
use weaver_geometry::glam::DVec3;
use weaver_geometry::lens::LensCamera;

/// Side of the squares in which nearer points hide others, pixels.
const SQUARE: usize = 4;
/// A point this many times as far as the nearest one of its square is taken to be hidden.
const HIDDEN: f32 = 1.2;

/// The points that a photo sees, ascending, and a depth map of them with the nearest point of each pixel.
///
/// If the capture has tracks, they are the track's points inside this photo. Else they are the nearest point of each
/// pixel, unless another one close by is much nearer.
pub(super) fn visible_points(camera: &LensCamera, capture: &Photos, photo: &Photo) -> (Vec<u32>, Vec<f32>) {
    if capture.tracked() || capture.points.is_empty() {
        tracked(camera, &capture.points, &photo.track)
    } else {
        nearest(camera, &capture.points)
    }
}

/// The pixel that shows a point, and its depth; `None` outside the image and behind the camera.
fn seen(lens: &LensCamera, point: DVec3) -> Option<(usize, usize, f32)> {
    let camera = &lens.camera;
    let (pixel, depth) = lens.see(camera.pose.apply(point))?;
    let pixel = pixel.floor();
    let inside = pixel.x >= 0.0 && pixel.x < camera.width as f64 && pixel.y >= 0.0 && pixel.y < camera.height as f64;
    inside.then_some((pixel.x as usize, pixel.y as usize, depth as f32))
}

fn tracked(lens: &LensCamera, points: &[DVec3], track: &[u32]) -> (Vec<u32>, Vec<f32>) {
    let camera = &lens.camera;
    let mut visible = Vec::with_capacity(track.len());
    let mut depth = vec![0.0_f32; camera.width * camera.height];
    for &index in track {
        if let Some((x, y, z)) = seen(lens, points[index as usize]) {
            visible.push(index);
            let cell = &mut depth[y * camera.width + x];
            if *cell == 0.0 || z < *cell {
                *cell = z;
            }
        }
    }
    (visible, depth)
}

fn nearest(lens: &LensCamera, points: &[DVec3]) -> (Vec<u32>, Vec<f32>) {
    let camera = &lens.camera;
    let (columns, rows) = (camera.width.div_ceil(SQUARE), camera.height.div_ceil(SQUARE));
    let mut squares = vec![f32::INFINITY; columns * rows];
    let mut pixels: Vec<Option<(u32, f32)>> = vec![None; camera.width * camera.height];
    for (index, point) in (0..).zip(points) {
        let Some((x, y, z)) = seen(lens, *point) else { continue };
        let square = &mut squares[y / SQUARE * columns + x / SQUARE];
        *square = square.min(z);
        let pixel = &mut pixels[y * camera.width + x];
        if pixel.is_none_or(|(_, nearest)| z < nearest) {
            *pixel = Some((index, z));
        }
    }
    let mut visible = Vec::new();
    let mut depth = vec![0.0; pixels.len()];
    for (at, pixel) in pixels.into_iter().enumerate() {
        let square = at / camera.width / SQUARE * columns + at % camera.width / SQUARE;
        if let Some((index, z)) = pixel.filter(|(_, z)| *z <= HIDDEN * squares[square]) {
            visible.push(index);
            depth[at] = z;
        }
    }
    visible.sort_unstable();
    (visible, depth)
}
