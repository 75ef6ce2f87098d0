//! Keypoints in the order of where they are, for finding those near a line.

use crate::descriptor::DESCRIPTOR;
use crate::features::Features;
use weaver_geometry::glam::{DVec2, DVec3};

/// Keypoints of a cell, on average: fewer make more cells to go through, more make more keypoints that are not near.
const PER_CELL: f64 = 2.0;

/// The keypoints of a photo in a grid of square cells.
#[derive(Debug)]
pub(crate) struct Near {
    /// The number of each keypoint in the photo, cell by cell.
    pub numbers: Vec<u32>,
    /// The descriptors in this order.
    pub descriptors: Vec<u8>,
    /// The places in this order, pixels.
    places: Vec<[f32; 2]>,
    /// The first corner of the first cell and a cell's side, pixels.
    corner: DVec2,
    side: f64,
    columns: usize,
    /// Where each cell begins, row by row, and where the last ends.
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
        let of = |i: &u32| &features.descriptors[*i as usize * DESCRIPTOR..][..DESCRIPTOR];
        Self {
            descriptors: numbers.iter().flat_map(of).copied().collect(),
            places: numbers.iter().map(|i| keypoints[*i as usize].pixel.as_vec2().to_array()).collect(),
            numbers,
            corner,
            side,
            columns,
            starts,
        }
    }

    /// Where in this order the keypoints are that lie within `farthest` pixels of the line a u + b v + c = 0 with a^2 + b^2 = 1;
    /// all where a = b = c = 0.
    pub fn band(&self, line: DVec3, farthest: f64, found: &mut Vec<u32>) {
        found.clear();
        let rows = (self.starts.len() - 1) / self.columns;
        let [a, b, c] = line.as_vec3().to_array();
        // A little more than what is asked, so that rounding leaves none out.
        let reach = farthest + 1e-3 * self.side;
        for row in 0..rows {
            let [top, bottom] = [0.0, 1.0].map(|k| line.y * (self.corner.y + self.side * (row as f64 + k)));
            // a u must lie between these somewhere in the row.
            let [least, most] = [-reach - line.z - top.max(bottom), reach - line.z - top.min(bottom)];
            let Some([left, right]) = self.crossed(line.x, least, most) else { continue };
            let first = self.starts[row * self.columns + left] as usize;
            let last = self.starts[row * self.columns + right + 1] as usize;
            for (i, [u, v]) in self.places[first..last].iter().enumerate() {
                if (a * u + b * v + c).abs() <= farthest as f32 {
                    found.push((first + i) as u32);
                }
            }
        }
    }

    /// The first and the last column of cells in which `a u` lies between two numbers somewhere.
    fn crossed(&self, a: f64, least: f64, most: f64) -> Option<[usize; 2]> {
        let last = self.columns - 1;
        let width = self.side * self.columns as f64 + self.corner.x.abs();
        if a.abs() * width < 1e-6 * self.side {
            // The line hardly moves along a row.
            return (least <= 1e-3 * self.side && most >= -1e-3 * self.side).then_some([0, last]);
        }
        let ends = [least / a, most / a].map(|u| (u - self.corner.x) / self.side);
        let (left, right) = (ends[0].min(ends[1]), ends[0].max(ends[1]));
        if right < 0.0 || left > self.columns as f64 {
            return None;
        }
        Some([(left.max(0.0) as usize).min(last), (right.max(0.0) as usize).min(last)])
    }
}
