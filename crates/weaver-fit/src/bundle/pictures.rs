//! What bundle adjustment looks at: the detail of photos, and depth.

use crate::photos::Photo;
use weaver_geometry::Camera;
use weaver_geometry::glam::{DVec2, DVec3};

/// Pixels to each side of the window whose mean is taken off: exposure and shading are no detail.
const WINDOW: usize = 6;

/// A photo at some size with the depth of the scene.
#[derive(Clone, Debug)]
pub(super) struct Picture<'a> {
    /// The camera: its intrinsics count, its pose is that of [`Cameras`](super::Cameras).
    pub camera: Camera,
    /// Depth `[H, W]`, 0 where the scene is transparent.
    pub depth: Vec<f32>,
    /// What counts, `[H, W]`.
    mask: Option<&'a [u8]>,
    /// Gray less its mean around, and its slopes to the right and down, `[H, W]` each.
    detail: Vec<[f32; 3]>,
}

impl<'a> Picture<'a> {
    pub fn new(photo: &'a Photo, depth: Vec<f32>) -> Self {
        let camera = photo.camera;
        let (width, height) = (camera.width, camera.height);
        let gray: Vec<f32> =
            photo.rgb.chunks_exact(3).map(|c| c.iter().map(|c| f32::from(*c)).sum::<f32>() / 765.0).collect();
        let mean = box_mean(&box_mean(&gray, width, height, 1, width), height, width, width, 1);
        let high: Vec<f32> = gray.iter().zip(&mean).map(|(a, b)| a - b).collect();
        let detail = (0..width * height)
            .map(|at| {
                let (x, y) = (at % width, at / width);
                let slope = |low: usize, up: usize, next: usize| {
                    if low == 0 || low + 1 == up { 0.0 } else { 0.5 * (high[at + next] - high[at - next]) }
                };
                [high[at], slope(x, width, 1), slope(y, height, width)]
            })
            .collect();
        Self { camera, depth, mask: photo.mask.as_deref(), detail }
    }

    /// Detail and its slopes at a place between pixels; `None` outside the picture and where it does not count.
    pub fn at(&self, place: DVec2) -> Option<DVec3> {
        let (x, y) = (place.x - 0.5, place.y - 0.5);
        let inside = x >= 1.0 && y >= 1.0 && x < (self.camera.width - 2) as f64 && y < (self.camera.height - 2) as f64;
        if !inside {
            return None;
        }
        let (left, top) = (x as usize, y as usize);
        let (u, v) = (x - left as f64, y - top as f64);
        let at = top * self.camera.width + left;
        if self.mask.is_some_and(|mask| mask[at] == 0) {
            return None;
        }
        let pixel = |at: usize| DVec3::from(self.detail[at].map(f64::from));
        let row = |at: usize| pixel(at) * (1.0 - u) + pixel(at + 1) * u;
        Some(row(at) * (1.0 - v) + row(at + self.camera.width) * v)
    }

    /// How much there is to see at a pixel: the square of the slope.
    pub fn texture(&self, at: usize) -> f32 {
        let [_, u, v] = self.detail[at];
        u * u + v * v
    }

    /// The median depth of the scene; `None` where there is none.
    pub fn median_depth(&self) -> Option<f64> {
        let mut depths: Vec<f32> = self.depth.iter().copied().filter(|z| *z > 0.0).collect();
        depths.sort_unstable_by(f32::total_cmp);
        depths.get(depths.len() / 2).map(|z| f64::from(*z))
    }

    /// The depth at the pixel of a place, if something is there.
    pub fn depth_at(&self, place: DVec2) -> Option<f64> {
        let (x, y) = (place.x as usize, place.y as usize);
        let inside = place.x >= 0.0 && place.y >= 0.0 && x < self.camera.width && y < self.camera.height;
        inside.then(|| f64::from(self.depth[y * self.camera.width + x])).filter(|depth| *depth > 0.0)
    }
}

/// Means over windows along one axis: `count` lines of `length` numbers, `next` apart in a line, `line` between lines.
fn box_mean(from: &[f32], length: usize, count: usize, next: usize, line: usize) -> Vec<f32> {
    let mut to = vec![0.0; from.len()];
    for i in 0..count {
        for j in 0..length {
            let window = j.saturating_sub(WINDOW)..(j + WINDOW + 1).min(length);
            let part = window.len() as f32;
            to[i * line + j * next] = window.map(|k| from[i * line + k * next]).sum::<f32>() / part;
        }
    }
    to
}
