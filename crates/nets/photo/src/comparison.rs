//! Depth that photos agree about: the network's prior, of real photos.

use weaver_data::SparsePoints;
use weaver_geometry::Camera;
use weaver_geometry::glam::DVec3;
use weaver_inference::{Error, Photos};
use weaver_kernels::order::median_high;
use weaver_scene::{Photo, PointCloud};
use weaver_stereo::{Stereo, StereoSettings};

/// Depth beyond which all counts as far, in median depths of the scene.
pub const FAR: f32 = 20.0;

/// Depth along the optical axis `[V, H, W]` where comparing photos found it, 0 elsewhere; `f32::INFINITY` at infinity.
#[derive(Clone, Debug, PartialEq)]
pub struct Comparison {
    /// The depth, in the units of the cameras.
    pub depth: Vec<f32>,
}

impl Comparison {
    /// Compares photos with cameras ([`Stereo`]): depth where two other photos agree, beside the points that photos
    /// see. With two photos nothing but the points is known.
    ///
    /// Cost: 250 planes tried in each pixel. The same bits at any number of threads.
    ///
    /// # Errors
    /// A photo that sees no points; photos that were all taken at one place.
    pub fn of(photos: Photos<'_>, cameras: &[Camera], points: &SparsePoints) -> Result<Self, Error> {
        let Photos { height, width, .. } = photos;
        check(cameras, points)?;
        let all: Vec<Photo> = (0..cameras.len()).map(|view| photo(photos, view, cameras[view])).collect();
        let place = |at: &DVec3| at.as_vec3().to_array();
        let positions: Vec<[f32; 3]> = points.positions.iter().map(place).collect();
        let cloud = PointCloud { colors: vec![[0; 3]; positions.len()], positions };
        let settings = StereoSettings { long_side: height.max(width).min(LONGEST), ..StereoSettings::default() };
        let stereo = Stereo::of(&all, &cloud, &points.visible, &settings);
        let mut depth = Vec::with_capacity(cameras.len() * height * width);
        for (view, camera) in cameras.iter().enumerate() {
            let (found, [rows, columns]) = stereo.depth(view);
            let first = depth.len();
            let from = |at: usize| {
                let (row, column) = (at / width * rows / height, at % width * columns / width);
                let z = found[row * columns + column];
                if z.is_nan() { 0.0 } else { z }
            };
            depth.extend((0..height * width).map(from));
            for point in &points.visible[view] {
                let local = camera.pose.apply(points.positions[*point as usize]);
                let pixel = camera.intrinsics.project(local);
                let inside = (0.0..width as f64).contains(&pixel.x) && (0.0..height as f64).contains(&pixel.y);
                if local.z > 0.0 && inside {
                    let own = &mut depth[first + pixel.y as usize * width + pixel.x as usize];
                    if *own == 0.0 {
                        *own = local.z as f32;
                    }
                }
            }
        }
        Ok(Self { depth })
    }

    /// The median of the depths that are known and finite; `None` without any.
    pub fn median(&self) -> Option<f32> {
        median_high(&mut self.depth.iter().copied().filter(|z| *z > 0.0 && z.is_finite()).collect::<Vec<_>>())
    }

    /// The part of the pixels whose depth is known.
    pub fn coverage(&self) -> f64 {
        self.depth.iter().filter(|z| **z > 0.0).count() as f64 / self.depth.len().max(1) as f64
    }
}

/// Longest side at which photos are compared, pixels: larger ones are compared at a whole fraction of their size.
const LONGEST: usize = 256;
/// The least distance between two photos, over the mean distance to the points.
const LEAST_BASELINE: f64 = 1e-4;

fn check(cameras: &[Camera], points: &SparsePoints) -> Result<(), Error> {
    let count = cameras.len();
    if let Some(view) = points.visible.iter().position(Vec::is_empty) {
        return Err(Error::Input(format!(
            "photo {} of {count}: expected points that another photo shows too, found none",
            view + 1
        )));
    }
    let Some(first) = cameras.first().map(|camera| camera.pose.center()) else { return Ok(()) };
    let farthest = cameras.iter().map(|camera| camera.pose.center().distance(first)).fold(0.0, f64::max);
    let distance = points.mean_distance(first).unwrap_or(0.0);
    if farthest <= LEAST_BASELINE * distance {
        return Err(Error::Input(format!(
            "expected photos from different places, found {count} from one place: depth cannot be compared"
        )));
    }
    Ok(())
}

/// One of the photos as comparison takes it.
fn photo(photos: Photos<'_>, view: usize, camera: Camera) -> Photo {
    let pixels = photos.height * photos.width;
    let planes = &photos.planes[3 * view * pixels..][..3 * pixels];
    let byte = |x: f32| (x.clamp(0.0, 1.0) * 255.0).round() as u8;
    let rgb = (0..3 * pixels).map(|i| byte(planes[i % 3 * pixels + i / 3])).collect();
    let mask = photos.inside.map(|inside| inside[view * pixels..][..pixels].to_vec());
    Photo { name: (view + 1).to_string(), camera, rgb, mask, lens: None }
}
