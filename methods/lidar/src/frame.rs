//! Range images of scans.

use crate::eigen::principal;
use crate::scan::vector;
use crate::{Error, Result, Scan};
use rayon::prelude::*;
use weaver_geometry::glam::DVec3;
use weaver_kernels::nearest_neighbors::nearest_neighbors;
use weaver_surfel::SurfelCamera;

/// Least number of filled pixels of a scan.
const LEAST_PIXELS: usize = 100;
/// Neighbors in the estimate of a normal.
const NORMAL_NEIGHBORS: usize = 12;

/// A scan as a range image: in each pixel the nearest point, ties by index.
#[derive(Clone, Debug, PartialEq)]
pub struct Frame {
    /// The camera.
    pub camera: SurfelCamera,
    /// Range of each pixel, `[H, W]`, meters; 0 without a point. The range of the point or, with normals, of the middle
    /// of the pixel.
    pub range: Vec<f32>,
    /// Pixels with a point, ascending, `[n]`.
    pub pixels: Vec<u32>,
    /// Their points in the sensor's frame, `[n]`.
    pub points: Vec<DVec3>,
    /// Normals of the points toward the sensor, `[n]`; empty before [`with_normals`](Self::with_normals).
    pub normals: Vec<DVec3>,
}

impl Frame {
    /// Projects a scan.
    ///
    /// # Errors
    /// [`Error::FewPixels`] below 100 pixels.
    pub fn new(scan: &Scan, camera: &SurfelCamera, of: &str) -> Result<Self> {
        let mut nearest = vec![(f64::INFINITY, u32::MAX); camera.pixels()];
        for (i, p) in scan.points.iter().enumerate() {
            let p = vector(p);
            let (at, range) = (camera.project(p), p.length());
            // Azimuths of exactly half a turn fall behind the last column.
            let column = at.x.floor().rem_euclid(camera.width as f64) as usize;
            if !(at.y >= 0.0 && at.y < camera.height as f64 && range > 0.0) {
                continue;
            }
            let pixel = &mut nearest[at.y as usize * camera.width + column.min(camera.width - 1)];
            if range < pixel.0 {
                *pixel = (range, i as u32);
            }
        }
        let range = nearest.iter().map(|(range, _)| if range.is_finite() { *range as f32 } else { 0.0 }).collect();
        let filled = || nearest.iter().enumerate().filter(|(_, (_, i))| *i != u32::MAX);
        let pixels: Vec<u32> = filled().map(|(pixel, _)| pixel as u32).collect();
        let points = filled().map(|(_, (_, i))| vector(&scan.points[*i as usize])).collect();
        if pixels.len() < LEAST_PIXELS {
            return Err(Error::FewPixels { of: of.into(), found: pixels.len(), least: LEAST_PIXELS });
        }
        Ok(Self { camera: *camera, range, pixels, points, normals: Vec::new() })
    }

    /// Adds normals: the direction of least spread of the 12 nearest points, or the direction to the sensor for points
    /// that form no surface.
    ///
    /// With them, ranges become the ranges of the middles of pixels: a point p with normal n is moved to the
    /// intersection of the ray d of its pixel with its plane, n.p / n.d. A beam is up to half a pixel off that ray,
    /// which at 20 m and 128 rows is decimeters on a slanted surface.
    #[must_use]
    pub fn with_normals(mut self) -> Self {
        if self.normals.is_empty() {
            self.normals = normals(&self.points);
            for ((pixel, p), normal) in self.pixels.iter().zip(&self.points).zip(&self.normals) {
                let pixel = *pixel as usize;
                let ray = self.camera.pixel_ray(pixel % self.camera.width, pixel / self.camera.width);
                if let Some(range) = plane_range(*p, *normal, ray) {
                    self.range[pixel] = range as f32;
                }
            }
        }
        self
    }

    /// The relative change of the range from pixel to pixel, |grad log r|, at each point, `[n]`; 0 beside pixels
    /// without a point.
    pub fn log_gradients(&self) -> Vec<f64> {
        let (width, height) = (self.camera.width, self.camera.height);
        let log = |row: usize, column: usize| {
            let r = self.range[row * width + column % width];
            (r > 0.0).then(|| f64::from(r).ln())
        };
        let half = |a: Option<f64>, b: Option<f64>| a.zip(b).map_or(0.0, |(a, b)| 0.5 * (b - a));
        let at = |pixel: &u32| {
            let (row, column) = (*pixel as usize / width, *pixel as usize % width);
            let across = half(log(row, column + width - 1), log(row, column + 1));
            let inside = row > 0 && row + 1 < height;
            let down = if inside { half(log(row - 1, column), log(row + 1, column)) } else { 0.0 };
            across.hypot(down)
        };
        self.pixels.iter().map(at).collect()
    }
}

/// Least |n.d| of a ray for the extension of a plane.
const GRAZING: f64 = 0.1;

/// The range at the intersection of a ray with the plane through `p` with a normal; `None` at grazing incidence.
pub(crate) fn plane_range(p: DVec3, normal: DVec3, ray: DVec3) -> Option<f64> {
    let toward = normal.dot(ray);
    Some(normal.dot(p) / toward).filter(|range| toward.abs() >= GRAZING && *range > 0.0)
}

/// Normals of points toward the origin.
pub(crate) fn normals(points: &[DVec3]) -> Vec<DVec3> {
    let k = NORMAL_NEIGHBORS;
    let flat: Vec<f64> = points.iter().flat_map(|p| p.to_array()).collect();
    let mut neighbors = vec![0; (k + 1) * points.len()];
    nearest_neighbors(&flat, k, &mut neighbors);
    let rows = neighbors.par_chunks_exact(k + 1).zip(points);
    rows.map(|(row, p)| {
        let (_, values, vectors) = principal(row.iter().map(|i| points[*i as usize]));
        let toward = -p.normalize_or_zero();
        let normal = vectors[0];
        // A line, or a ball, has no normal.
        let flat = values[1] > 4.0 * values[0].max(0.0) && values[1] > 1e-3 * values[2];
        match flat && normal.is_finite() {
            true => normal * normal.dot(toward).signum(),
            false => toward,
        }
    })
    .collect()
}
