//! A bar of known length that photos show.

use crate::{BarFit, Error, EstimatedPhotos};
use std::path::Path;
use weaver_geometry::Camera;
use weaver_geometry::glam::{DMat3, DVec2, DVec3};
use weaver_io::read_scale_bar;

/// Rounds of moving an end to where photos show it.
const ROUNDS: usize = 10;

/// A bar in the world of the estimate.
#[derive(Debug)]
pub(super) struct Bar {
    length: f64,
    /// Its length in that world, where at least two of its photos have a camera.
    found: Option<f64>,
    photos: usize,
    /// Root of the mean square error, pixels of the photos as they are.
    error: f64,
}

impl Bar {
    /// Triangulates the ends of a bar.
    pub fn read(found: &EstimatedPhotos, file: &Path) -> Result<Self, Error> {
        let rows = read_scale_bar(file)?;
        let mut seen: Vec<(Camera, f64, [DVec2; 2])> = Vec::new();
        for row in &rows {
            let name = Path::new(&row.name).file_name().unwrap_or_default();
            let at = found.paths.iter().position(|path| path.file_name() == Some(name));
            let Some(at) = at else {
                return Err(Error::unexpected(file, "name", "the name of one of the photos", row.name.as_str()));
            };
            let Ok(camera) = found.estimate.cameras[at] else { continue };
            let larger = found.sizes[at].0 as f64 / camera.width as f64;
            let straight = |pixel: DVec2| {
                let k = camera.intrinsics;
                let ray = (pixel / larger - DVec2::new(k.cx, k.cy)) / DVec2::new(k.fx, k.fy);
                found.estimate.distortion[at].map_or(Some(ray), |lens| lens.undistort(ray))
            };
            if let (Some(a), Some(b)) = (straight(row.ends[0]), straight(row.ends[1])) {
                seen.push((camera, larger, [a, b]));
            }
        }
        if seen.len() < 2 {
            return Ok(Self { length: rows[0].length, found: None, photos: seen.len(), error: 0.0 });
        }
        let end = |which: usize| triangulated(seen.iter().map(|(camera, _, rays)| (camera, rays[which])));
        let ends = [end(0), end(1)];
        let squares = seen.iter().flat_map(|(camera, larger, rays)| {
            [0, 1].map(|i| {
                let at = camera.pose.apply(ends[i]);
                let off = DVec2::new(at.x, at.y) / at.z - rays[i];
                (off * camera.intrinsics.fx * *larger).length_squared()
            })
        });
        let error = (squares.sum::<f64>() / (2 * seen.len()) as f64).sqrt();
        let (length, between) = (rows[0].length, ends[0].distance(ends[1]));
        if !(between > 0.0 && between.is_finite() && error.is_finite()) {
            let expected = "two ends that photos show from different places";
            return Err(Error::unexpected(file, "ends", expected, "rays that do not meet"));
        }
        Ok(Self { length, found: Some(between), photos: seen.len(), error })
    }

    /// Meters for a unit of the world, where photos show the bar.
    pub fn scale(&self) -> Option<f64> {
        self.found.map(|found| self.length / found)
    }

    /// The bar in a world that was scaled.
    pub fn fit(&self, scale: f64) -> BarFit {
        BarFit {
            length: self.length,
            found: self.found.unwrap_or(0.0) * scale,
            photos: self.photos,
            error_pixels: self.error,
        }
    }
}

/// The point that cameras see in directions over depth: the middle of the rays, then Gauss-Newton on the differences in
/// the photos.
fn triangulated<'a>(seen: impl Iterator<Item = (&'a Camera, DVec2)> + Clone) -> DVec3 {
    let (mut normal, mut right) = (DMat3::ZERO, DVec3::ZERO);
    for (camera, ray) in seen.clone() {
        let along = (camera.pose.rotation.transpose() * ray.extend(1.0)).normalize();
        let across = DMat3::IDENTITY - DMat3::from_cols(along * along.x, along * along.y, along * along.z);
        normal += across;
        right += across * camera.pose.center();
    }
    let mut point = normal.inverse() * right;
    for _ in 0..ROUNDS {
        let (mut normal, mut right) = (DMat3::ZERO, DVec3::ZERO);
        for (camera, ray) in seen.clone() {
            let at = camera.pose.apply(point);
            let r = camera.pose.rotation;
            for (axis, wanted, value) in [(0, ray.x, at.x), (1, ray.y, at.y)] {
                let slope = (r.row(axis) - r.row(2) * (value / at.z)) / at.z;
                normal += DMat3::from_cols(slope * slope.x, slope * slope.y, slope * slope.z);
                right += slope * (wanted - value / at.z);
            }
        }
        point += normal.inverse() * right;
    }
    point
}

#[cfg(test)]
mod tests {
    use super::*;
    use weaver_geometry::Intrinsics;
    use weaver_geometry::trajectory::look_at;

    #[test]
    fn rays_meet_where_the_point_is() {
        let intrinsics = Intrinsics { fx: 1.0, fy: 1.0, cx: 0.0, cy: 0.0 };
        let camera = |x: f64| {
            let pose = look_at(DVec3::new(x, 0.3 * x, -2.0), DVec3::ZERO, DVec3::Y);
            Camera { pose, intrinsics, width: 1, height: 1 }
        };
        let cameras = [camera(0.0), camera(0.5), camera(-1.0)];
        let point = DVec3::new(0.1, -0.2, 0.3);
        let rays: Vec<(&Camera, DVec2)> = (cameras.iter())
            .map(|camera| {
                let at = camera.pose.apply(point);
                (camera, DVec2::new(at.x, at.y) / at.z)
            })
            .collect();
        assert!(triangulated(rays.into_iter()).distance(point) < 1e-12);
    }
}
