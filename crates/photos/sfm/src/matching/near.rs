//! Keypoints sorted by place, for finding the ones near a line.

use crate::descriptor::DESCRIPTOR;
use crate::features::Features;
use std::ops::Range;
use weaver_geometry::glam::{DVec2, DVec3};

/// Keypoints of a cell, on average: smaller cells are more to go through, larger ones hold more keypoints that are not
/// near.
const PER_CELL: f64 = 2.0;
/// Lines whose normals have a smaller component across or down are taken to be level or upright.
const LEVEL: f64 = 1e-3;

/// The keypoints of a photo in a grid of square cells.
#[derive(Debug)]
pub(crate) struct Near {
    /// The number of each keypoint in the photo, cell by cell.
    pub numbers: Vec<u32>,
    /// The descriptors in this order.
    pub descriptors: Vec<u8>,
    /// The places in this order, pixels.
    places: Vec<[f32; 2]>,
    /// The first corner of the first cell, pixels.
    corner: DVec2,
    /// A cell's side, pixels.
    side: f64,
    columns: usize,
    rows: usize,
    /// Start of each cell, row by row, and the end of the last.
    starts: Vec<u32>,
}

impl Near {
    /// Sorts the keypoints of a photo.
    pub fn new(features: &Features) -> Self {
        let keypoints = &features.keypoints;
        let corners = keypoints.iter().map(|k| [k.pixel, k.pixel]);
        let extent = corners.reduce(|[low, high], [a, b]| [low.min(a), high.max(b)]);
        let [corner, end] = extent.unwrap_or_default();
        let size = end - corner;
        let area = size.x * size.y * PER_CELL / keypoints.len().max(1) as f64;
        // Keypoints along a line alone have no area.
        let side = area.sqrt().max(size.max_element() / 1000.0).max(1.0);
        let [columns, rows] = (size / side).to_array().map(|cells| cells as usize + 1);
        let cell = |at: DVec2| {
            let [x, y] = ((at - corner) / side).to_array().map(|cells| cells as usize);
            y * columns + x
        };
        let mut starts = vec![0_u32; columns * rows + 1];
        keypoints.iter().for_each(|k| starts[cell(k.pixel) + 1] += 1);
        for i in 0..columns * rows {
            starts[i + 1] += starts[i];
        }
        let mut next = starts.clone();
        let mut numbers = vec![0; keypoints.len()];
        for (number, keypoint) in keypoints.iter().enumerate() {
            let at = &mut next[cell(keypoint.pixel)];
            numbers[*at as usize] = number as u32;
            *at += 1;
        }
        let mut descriptors = Vec::with_capacity(features.descriptors.len());
        for number in &numbers {
            descriptors.extend_from_slice(&features.descriptors[*number as usize * DESCRIPTOR..][..DESCRIPTOR]);
        }
        let places = numbers.iter().map(|i| keypoints[*i as usize].pixel.as_vec2().to_array()).collect();
        Self { numbers, descriptors, places, corner, side, columns, rows, starts }
    }

    /// The keypoints, by their place in this order, within `farthest` pixels of the line a u + b v + c = 0 with a^2 +
    /// b^2 = 1; all if a = b = c = 0. They are the first numbers of `found`, as many as are returned.
    pub fn band(&self, line: DVec3, farthest: f64, found: &mut Vec<u32>) -> usize {
        found.resize(self.places.len(), 0);
        let [a, b, c] = line.as_vec3().to_array();
        let near = farthest as f32;
        let across = self.across(line, farthest);
        let mut count = 0;
        for row in self.down(line, farthest) {
            let (first, last) = across.columns(row as f32);
            let (first, last) = (first.min(self.columns), last.min(self.columns));
            let row = row * self.columns;
            let cells = self.starts[row + first] as usize..self.starts[row + last] as usize;
            for (i, [u, v]) in cells.clone().zip(&self.places[cells]) {
                // A number too far away is overwritten by the next.
                found[count] = i as u32;
                count += usize::from((a * u + b * v + c).abs() <= near);
            }
        }
        count
    }

    /// The rows of cells that a band may pass through.
    fn down(&self, line: DVec3, farthest: f64) -> Range<usize> {
        // In cells, from the first corner, with a small margin, so that rounding leaves none out.
        let reach = farthest / self.side + 1e-2;
        let offset = (line.dot(self.corner.extend(1.0))) / self.side;
        let ends = [0.0, line.x * self.columns as f64].map(|u| offset + u);
        // b v lies between these.
        let (least, most) = (-reach - ends[0].max(ends[1]), reach - ends[0].min(ends[1]));
        if line.y.abs() < LEVEL {
            return 0..self.rows;
        }
        let (top, bottom) = ((least / line.y).min(most / line.y), (least / line.y).max(most / line.y));
        (top.max(0.0) as usize).min(self.rows)..((bottom + 1.0).max(0.0) as usize).min(self.rows)
    }

    /// Columns of cells that a band passes through in a row.
    fn across(&self, line: DVec3, farthest: f64) -> Across {
        let offset = line.dot(self.corner.extend(1.0)) / self.side;
        if line.x.abs() < LEVEL {
            return Across { slope: 0.0, start: 0.0, width: self.columns as f32 };
        }
        // u = -(offset + b v) / a for v from the row to the next, in cells.
        let (slope, reach) = (-line.y / line.x, (farthest / self.side + 1e-2) / line.x.abs());
        let start = -offset / line.x + slope.min(0.0) - reach;
        Across { slope: slope as f32, start: start as f32, width: (2.0 * reach + slope.abs()) as f32 }
    }
}

/// A band in cells: in row v from start + slope v on.
struct Across {
    slope: f32,
    start: f32,
    width: f32,
}

impl Across {
    /// The first column, and the one after the last.
    #[inline(always)]
    fn columns(&self, row: f32) -> (usize, usize) {
        let first = self.start + self.slope * row;
        (first.max(0.0) as usize, (first + self.width + 1.0).max(0.0) as usize)
    }
}
