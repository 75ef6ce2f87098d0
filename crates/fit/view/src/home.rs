//! Where a page begins to look from, and the picture that it shows until it can draw.

use crate::ViewError;
use crate::subject::{Shot, Subject, lens_json};
use serde_json::{Value, json};
use weaver_geometry::glam::DVec3;
use weaver_geometry::{Camera, Intrinsics, trajectory};
use weaver_io::{Bitmap, Image};
use weaver_kernels::order::{median_high, nth};
use weaver_scene::CameraRows;
use weaver_splat::{CpuRasterizer, Images, Rasterizer};

/// Longest side of the picture, pixels.
const LONG_SIDE: f64 = 640.0;
/// Quality of the picture as libjpeg counts it.
const QUALITY: u8 = 82;
/// The part of the picture's sides around its middle whose depth is the target's.
const MIDDLE: f64 = 0.2;
/// Distance from a scene without cameras, in radii.
const AWAY: f64 = 1.8;
/// The part of the Gaussians at either end of each axis that does not count for the size of a scene.
const OUTSIDE: f64 = 0.03;

/// The first view, and a picture of it.
pub(crate) struct Home {
    camera: Camera,
    up: DVec3,
    distance: f64,
    /// A JPEG file.
    pub picture: Vec<u8>,
}

impl Home {
    pub fn of(subject: &Subject<'_>, shots: &[Shot]) -> Result<Self, ViewError> {
        let (camera, distance) = match shots.first() {
            Some(shot) => (shot.camera, None),
            None => before(subject),
        };
        let camera = shrunk(camera);
        let up: DVec3 = shots.iter().map(|shot| -shot.camera.pose.rotation.row(1)).sum();
        let up = if up.length() > 0.1 * shots.len() as f64 { up.normalize() } else { DVec3::NEG_Y };
        let (picture, depth) = drawn(subject, &camera)?;
        let distance = distance.or(depth).or_else(|| before(subject).1).unwrap_or(1.0);
        Ok(Self { camera, up, distance, picture })
    }

    /// The view as scripts take it.
    pub fn json(&self) -> Value {
        let pose = &self.camera.pose;
        let (eye, forward, down) = (pose.center(), pose.rotation.row(2), pose.rotation.row(1));
        json!({
            "eye": eye.to_array(),
            "target": (eye + self.distance * forward).to_array(),
            "up": self.up.to_array(),
            "down": down.to_array(),
            "lens": lens_json(&self.camera),
        })
    }

    pub fn up(&self) -> [f64; 3] {
        self.up.to_array()
    }
}

/// A camera before the scene, toward -z of the world, and the distance of the scene's middle.
fn before(subject: &Subject<'_>) -> (Camera, Option<f64>) {
    let range = |axis: usize| {
        let mut values: Vec<f64> = subject.gaussians.means.iter().map(|mean| f64::from(mean[axis])).collect();
        let last = values.len().saturating_sub(1) as f64;
        [OUTSIDE, 1.0 - OUTSIDE].map(|share| nth(&mut values, (share * last) as usize).unwrap_or(0.0))
    };
    let ranges = [0, 1, 2].map(range);
    let middle = DVec3::from(ranges.map(|[low, high]| 0.5 * (low + high)));
    let radius = (0.5 * DVec3::from(ranges.map(|[low, high]| high - low)).length()).max(1e-3);
    let distance = AWAY * radius;
    let pose = trajectory::look_at(middle - distance * DVec3::Z, middle, DVec3::NEG_Y);
    let (width, height) = (640, 480);
    let focal = 0.5 * f64::from(width) / (0.5 * std::f64::consts::FRAC_PI_3).tan();
    let intrinsics = Intrinsics { fx: focal, fy: focal, cx: 320.0, cy: 240.0 };
    (Camera { pose, intrinsics, width: width as usize, height }, Some(distance))
}

/// The camera with an image of at most [`LONG_SIDE`].
fn shrunk(camera: Camera) -> Camera {
    let [width, height] = [camera.width as f64, camera.height as f64];
    let scale = (LONG_SIDE / width.max(height)).min(1.0);
    let [w, h] = [width, height].map(|side| (side * scale).round().max(1.0));
    let intrinsics = camera.intrinsics.resized(w / width, h / height);
    Camera { intrinsics, width: w as usize, height: h as usize, ..camera }
}

/// The picture as a JPEG file, and the median depth in its middle.
fn drawn(subject: &Subject<'_>, camera: &Camera) -> Result<(Vec<u8>, Option<f64>), ViewError> {
    let Camera { width, height, .. } = *camera;
    let (mut image, mut alpha, mut depth) =
        (vec![0.0; 3 * width * height], vec![0.0; width * height], vec![0.0; width * height]);
    let rows = CameraRows::new(std::slice::from_ref(camera));
    let images = Images { image: &mut image, alpha: &mut alpha, depth: Some(&mut depth), features: None };
    let gaussians = subject.gaussians.to_activated();
    let cameras = rows.as_slices(&subject.look.background);
    CpuRasterizer.session().forward(&gaussians.as_slices(), &cameras, &subject.look.settings, images)?;
    let within =
        |at: usize, size: usize| (at as f64 + 0.5 - 0.5 * size as f64).abs() < 0.5 * MIDDLE * size as f64 + 1.0;
    let middle = (0..width * height).filter(|p| within(p % width, width) && within(p / width, height));
    let mut depths: Vec<f32> = middle.filter(|p| alpha[*p] > 0.3).map(|p| depth[p] / alpha[p]).collect();
    let pixels = Image { width, height, pixels: image }.to_bytes();
    let picture = Bitmap { width, height, pixels }.to_jpeg(QUALITY)?;
    Ok((picture, median_high(&mut depths).map(f64::from)))
}
