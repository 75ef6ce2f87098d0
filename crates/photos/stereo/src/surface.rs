//! The surface that photos agree about, and Gaussians on it.

use crate::cells::{Cell, cells};
use crate::depth::Stereo;
use weaver_geometry::glam::{DMat3, DQuat, DVec2, DVec3};
use weaver_scene::{Gaussians, forms};

/// The surface that photos agree about: pixels of all photos, each place in the photo that shows it best.
#[derive(Debug)]
pub struct Surface<'a> {
    stereo: &'a Stereo,
    /// For each photo the pixels that are its own.
    owned: Vec<Vec<bool>>,
}

/// Logarithm of the ratio of depths up to which two photos show the same place.
const SAME: f32 = 0.02;
/// Factor on density below which the earlier of two photos keeps a place.
const DENSER: f32 = 0.8;
/// Standard deviation of a Gaussian over the side of its cell.
const WIDTH: f64 = 0.6;
/// The most that a Gaussian on a slanted surface is drawn out.
const SLANT: f64 = 3.0;
/// Its thickness over its width.
const THIN: f64 = 0.3;
const OPACITY: f32 = 0.9;

impl Stereo {
    /// The surface that the photos agree about, each place in the photo that shows it best.
    pub fn surface(&self) -> Surface<'_> {
        Surface::of(self)
    }
}

impl<'a> Surface<'a> {
    fn of(stereo: &'a Stereo) -> Self {
        let photos = 0..stereo.pictures.len();
        let density: Vec<Vec<f32>> = photos.clone().map(|n| density(stereo, n)).collect();
        let owned = photos.map(|n| owned(stereo, &density, n)).collect();
        Self { stereo, owned }
    }

    /// Number of pixels.
    pub fn len(&self) -> usize {
        self.owned.iter().flatten().filter(|owned| **owned).count()
    }

    /// True if photos agree about nothing.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// At most so many flat Gaussians of degree 0 that cover the surface, small where its color or depth varies: one
    /// for each cell of quadtrees over the photos.
    pub fn gaussians(&self, count: usize) -> Gaussians {
        let mut gaussians = Gaussians::default();
        for cell in cells(&self.stereo.pictures, &self.stereo.maps, &self.owned, count) {
            self.place(&cell, &mut gaussians);
        }
        gaussians
    }

    fn place(&self, cell: &Cell, to: &mut Gaussians) {
        let camera = &self.stereo.pictures[cell.photo].camera;
        let map = &self.stereo.maps[cell.photo];
        let pixel = DVec2::new((cell.at % camera.width) as f64 + 0.5, (cell.at / camera.width) as f64 + 0.5);
        let w = f64::from(map.w[cell.at]);
        let intrinsics = &camera.intrinsics;
        let ray = intrinsics.unproject(pixel, 1.0);
        let normal = normal(ray, w, map.slope[cell.at].map(f64::from), [intrinsics.fx, intrinsics.fy]);
        // In the plane, the way in which depth grows fastest, and the way in which it stays.
        let downhill =
            (ray - normal * ray.dot(normal)).try_normalize().unwrap_or_else(|| normal.any_orthonormal_vector());
        let across = normal.cross(downhill);
        let cosine = ray.normalize().dot(normal).abs();
        let width = WIDTH * (cell.pixels as f64).sqrt() / (w * intrinsics.fx);
        let scales = [width, width * (1.0 / cosine).min(SLANT), THIN * width];
        let axes = camera.pose.rotation.transpose() * DMat3::from_cols(across, downhill, across.cross(downhill));
        let quat = DQuat::from_mat3(&axes);
        let mean = camera.pose.inverse().apply(ray / w);
        to.means.push(mean.as_vec3().to_array());
        to.log_scales.push(scales.map(|s| s.ln() as f32));
        to.quats.push([quat.w, quat.x, quat.y, quat.z].map(|x| x as f32));
        to.opacity_logits.push((OPACITY / (1.0 - OPACITY)).ln());
        to.sh.extend(cell.color.map(forms::harmonic));
    }
}

/// The normal of a plane in the camera's frame, from its inverse depth `w` at a ray (of depth 1) and its slope per
/// pixel: `w = n . ray` with n along `(a fx, b fy, w - a fx x - b fy y)`.
fn normal(ray: DVec3, w: f64, slope: [f64; 2], focal: [f64; 2]) -> DVec3 {
    let (a, b) = (slope[0] * focal[0], slope[1] * focal[1]);
    DVec3::new(a, b, w - a * ray.x - b * ray.y).try_normalize().unwrap_or(DVec3::Z)
}

/// Pixels for each unit of length of the surface, at each pixel of a photo; 0 at infinity, not a number where photos do
/// not agree.
fn density(stereo: &Stereo, photo: usize) -> Vec<f32> {
    let (camera, map) = (&stereo.pictures[photo].camera, &stereo.maps[photo]);
    let intrinsics = &camera.intrinsics;
    let of = |(at, w): (usize, &f32)| {
        let pixel = DVec2::new((at % camera.width) as f64 + 0.5, (at / camera.width) as f64 + 0.5);
        let (ray, w) = (intrinsics.unproject(pixel, 1.0), f64::from(*w));
        let normal = normal(ray, w, map.slope[at].map(f64::from), [intrinsics.fx, intrinsics.fy]);
        (intrinsics.fx * w * ray.normalize().dot(normal).abs().sqrt()) as f32
    };
    map.w.iter().enumerate().map(of).collect()
}

/// The pixels of a photo that show their place at least as densely as any other photo does.
fn owned(stereo: &Stereo, density: &[Vec<f32>], photo: usize) -> Vec<bool> {
    let (camera, map) = (&stereo.pictures[photo].camera, &stereo.maps[photo]);
    let back = camera.pose.inverse();
    let own = |at: usize| {
        let w = map.w[at];
        // A point at infinity has no place.
        if w.is_nan() || w <= 0.0 {
            return false;
        }
        let pixel = DVec2::new((at % camera.width) as f64 + 0.5, (at / camera.width) as f64 + 0.5);
        let point = back.apply(camera.intrinsics.unproject(pixel, 1.0 / f64::from(w))).as_vec3().to_array();
        let better = |other: &usize| {
            let Some((there, w)) = stereo.pictures[*other].place(point) else { return false };
            let theirs = density[*other][there];
            let least = if *other < photo { density[photo][at] * DENSER } else { density[photo][at] / DENSER };
            (w / stereo.maps[*other].w[there]).ln().abs() < SAME && theirs > least
        };
        !stereo.neighbors[photo].iter().any(better)
    };
    (0..map.w.len()).map(own).collect()
}
