//! Keypoints sorted by place, for finding the ones near a line.

use crate::descriptor::DESCRIPTOR;
use crate::features::Features;
use std::ops::Range;
use weaver_geometry::glam::{DVec2, DVec3};
use weaver_kernels::lanes::{self, LANES, LaneKernel, LaneMask, Lanes};

/// Keypoints of a cell, on average: smaller cells are more to go through, larger ones hold more keypoints that are not
/// near.
const PER_CELL: f64 = 4.0;
/// Lines whose normals have a smaller component across or down are taken to be level or upright.
const LEVEL: f64 = 1e-3;
/// The numbers of the bits that are set in each byte.
const SET: [[u8; 8]; 256] = {
    let mut all = [[0; 8]; 256];
    let mut at = 0;
    while at < 8 * 256 {
        let (byte, bit) = (at / 8, at % 8);
        if byte >> bit & 1 == 1 {
            all[byte][(byte & ((1 << bit) - 1)).count_ones() as usize] = bit as u8;
        }
        at += 1;
    }
    all
};

/// The keypoints of a photo in a grid of square cells.
#[derive(Debug)]
pub(crate) struct Near {
    /// The number of each keypoint in the photo, cell by cell.
    pub numbers: Vec<u32>,
    /// The descriptors in this order.
    pub descriptors: Vec<u8>,
    /// The places in this order, pixels: across, and down. A vector beyond the last has no place.
    places: [Vec<f32>; 2],
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
        let places = [0, 1].map(|k| {
            let of = numbers.iter().map(|i| keypoints[*i as usize].pixel.as_vec2()[k]);
            of.chain([f32::NAN; LANES]).collect()
        });
        Self { numbers, descriptors, places, corner, side, columns, rows, starts }
    }

    /// The keypoints, by their place in this order, within `farthest` pixels of the line a u + b v + c = 0 with a^2 +
    /// b^2 = 1; all if a = b = c = 0. They are the first numbers of `found`, as many as are returned.
    pub fn band(&self, line: DVec3, farthest: f64, found: &mut Vec<u32>) -> usize {
        found.resize(self.numbers.len() + LANES, 0);
        lanes::run(Band { near: self, line, farthest, found })
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
        let slope = -line.y / line.x;
        let reach = (farthest / self.side + 1e-2) / line.x.abs();
        let start = -offset / line.x + slope.min(0.0) - reach;
        Across { slope: slope as f32, start: start as f32, width: (2.0 * reach + slope.abs()) as f32 }
    }
}

/// The keypoints near a line.
struct Band<'a> {
    near: &'a Near,
    line: DVec3,
    farthest: f64,
    found: &'a mut [u32],
}

impl LaneKernel<f32> for Band<'_> {
    type Output = usize;
    #[inline(always)]
    fn run<V: Lanes<Scalar = f32>>(self) -> usize {
        let Self { near, line, farthest, found } = self;
        let [a, b, c] = line.as_vec3().to_array().map(V::splat);
        let most = V::splat(farthest as f32);
        let across = near.across(line, farthest);
        let [us, vs] = [&near.places[0][..], &near.places[1][..]];
        let mut count = 0;
        for row in near.down(line, farthest) {
            let (first, last) = across.columns(row as f32);
            let (first, last) = (first.min(near.columns), last.min(near.columns));
            let row = row * near.columns;
            let (mut at, end) = (near.starts[row + first] as usize, near.starts[row + last] as usize);
            while at < end {
                let (u, v) = (&us[at..], &vs[at..]);
                let u = V::load(u.first_chunk().expect("a vector"));
                let v = V::load(v.first_chunk().expect("a vector"));
                let mut bits = most.ge((a * u + b * v + c).abs()).bits();
                if end - at < LANES {
                    bits &= (1 << (end - at)) - 1;
                }
                for byte in bits.to_le_bytes() {
                    // Without branches, which would often be predicted wrong. Numbers beyond the last are overwritten.
                    let to: &mut [u32; 8] = found[count..].first_chunk_mut().expect("room for a vector");
                    for (to, bit) in to.iter_mut().zip(SET[usize::from(byte)]) {
                        *to = at as u32 + u32::from(bit);
                    }
                    count += byte.count_ones() as usize;
                    at += 8;
                }
            }
        }
        count
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
