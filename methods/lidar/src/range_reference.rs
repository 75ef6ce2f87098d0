//! The range image as the reference of registration.

use weaver_geometry::Pose;
use weaver_geometry::glam::{DVec2, DVec3};
use weaver_surfel::SurfelCamera;

/// Least change of the range to the next pixel at an edge, meters.
const EDGE: f64 = 0.5;

/// A range image with its smooth pixels.
#[derive(Clone, Debug, PartialEq)]
pub struct RangeReference {
    /// The camera.
    pub camera: SurfelCamera,
    /// Ranges `[H, W]`, meters; 0 at empty pixels.
    pub range: Vec<f64>,
    smooth: Vec<bool>,
}

impl RangeReference {
    /// The reference of ranges `[H, W]`, with 0 at empty pixels.
    ///
    /// # Panics
    ///
    /// If the lengths do not fit.
    pub fn new(camera: &SurfelCamera, range: Vec<f64>) -> Self {
        assert_eq!(range.len(), camera.pixels(), "a range for each pixel");
        let (width, height) = (camera.width, camera.height);
        let at = |row: usize, column: usize| range[row * width + column % width];
        let edge: Vec<bool> = (0..range.len())
            .map(|i| {
                let (row, column) = (i / width, i % width);
                let across = at(row, column + 1) - at(row, column + width - 1);
                let inside = row > 0 && row + 1 < height;
                let down = if inside { at(row + 1, column) - at(row - 1, column) } else { 0.0 };
                range[i] <= 0.0 || 0.5 * across.hypot(down) >= EDGE
            })
            .collect();
        let near = |i: usize| {
            let (row, column) = (i / width, i % width);
            let rows = row.saturating_sub(1)..(row + 2).min(height);
            rows.flat_map(|row| (0..3).map(move |k| row * width + (column + width - 1 + k) % width)).any(|j| edge[j])
        };
        let smooth = (0..range.len()).map(|i| !near(i)).collect();
        Self { camera: *camera, range, smooth }
    }

    /// The points of its nonempty pixels.
    pub fn points(&self) -> Vec<DVec3> {
        let width = self.camera.width;
        let filled = self.range.iter().enumerate().filter(|(_, r)| **r > 0.0);
        filled.map(|(i, r)| self.camera.pixel_ray(i % width, i / width) * *r).collect()
    }

    /// The index of the pixel at a place.
    pub(crate) fn pixel(&self, at: DVec2) -> Option<usize> {
        let (width, height) = (self.camera.width, self.camera.height);
        let column = (at.x.floor().rem_euclid(width as f64) as usize).min(width - 1);
        (at.y >= 0.0 && at.y < height as f64).then(|| at.y as usize * width + column)
    }

    /// Index of the nearest point in each pixel after the motion x, ties by index; `u32::MAX` without a point.
    pub(crate) fn nearest(&self, query: &[DVec3], x: &Pose) -> Vec<u32> {
        let mut nearest = vec![(f64::INFINITY, u32::MAX); self.range.len()];
        for (i, q) in query.iter().enumerate() {
            let p = x.apply(*q);
            let Some(pixel) = self.pixel(self.camera.project(p)) else { continue };
            let range = p.length();
            if range < nearest[pixel].0 {
                nearest[pixel] = (range, i as u32);
            }
        }
        nearest.into_iter().map(|(_, i)| i).collect()
    }

    /// The range at a place, bilinear between smooth pixels, and its change along columns and rows.
    pub(crate) fn sample(&self, at: DVec2) -> Option<(f64, DVec2)> {
        let (width, height) = (self.camera.width, self.camera.height);
        let (x, y) = (at.x - 0.5, at.y - 0.5);
        if !(y >= 0.0 && y <= (height - 1) as f64) {
            return None;
        }
        let (left, top) = (x.floor(), y.floor().min(height as f64 - 2.0).max(0.0));
        let (fx, fy) = (x - left, y - top);
        let columns = [0.0, 1.0].map(|k| (left + k).rem_euclid(width as f64) as usize % width);
        let rows = [top as usize, (top as usize + 1).min(height - 1)];
        let index = |row: usize, column: usize| rows[row] * width + columns[column];
        let corners = [index(0, 0), index(0, 1), index(1, 0), index(1, 1)];
        if !corners.iter().all(|i| self.smooth[*i]) {
            return None;
        }
        let [a, b, c, d] = corners.map(|i| self.range[i]);
        let (above, below) = (a + fx * (b - a), c + fx * (d - c));
        let slope = DVec2::new((1.0 - fy) * (b - a) + fy * (d - c), below - above);
        Some((above + fy * (below - above), slope))
    }
}
