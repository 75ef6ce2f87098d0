//! What the surroundings of a keypoint look like: directions and histograms of gradients.

use crate::scale_space::Gray;
use std::f32::consts::TAU;

/// Numbers of a descriptor: 4 x 4 cells of 8 directions.
pub const DESCRIPTOR: usize = CELLS * CELLS * DIRECTIONS;
/// Bins of the histogram that directions are read from.
const BINS: usize = 36;
/// Deviations of its window over the keypoint's, and its radius over those.
const WINDOW: f32 = 1.5;
const RADIUS: f32 = 3.0;
/// Peaks that are this part of the largest give a direction too.
const PEAK: f32 = 0.8;
/// Cells to a side of a descriptor, directions of a cell, and width of a cell over the keypoint's deviation.
const CELLS: usize = 4;
const DIRECTIONS: usize = 8;
const CELL: f32 = 3.0;
/// Largest part of a descriptor's length that one number may have: glare counts for no more.
const LARGEST: f32 = 0.2;

/// Size and direction of the gradient at a pixel inside.
#[inline]
fn gradient(image: &Gray, x: usize, y: usize) -> (f32, f32) {
    let dx = image.at(x + 1, y) - image.at(x - 1, y);
    let dy = image.at(x, y + 1) - image.at(x, y - 1);
    ((dx * dx + dy * dy).sqrt(), dy.atan2(dx))
}

/// The pixels within a radius, less the border.
fn around(image: &Gray, x: f32, y: f32, radius: f32) -> impl Iterator<Item = (usize, usize)> {
    let range = |at: f32, size: usize| {
        let low = (at - radius).ceil().max(1.0) as usize;
        low..((at + radius).floor().max(0.0) as usize + 1).min(size - 1)
    };
    let columns = range(x, image.width);
    range(y, image.height).flat_map(move |y| columns.clone().map(move |x| (x, y)))
}

/// Directions of a keypoint: where the histogram of gradients around it peaks.
pub(crate) fn orientations(image: &Gray, x: f32, y: f32, sigma: f32) -> Vec<f32> {
    let window = WINDOW * sigma;
    let mut raw = [0.0; BINS];
    for (i, j) in around(image, x, y, RADIUS * window) {
        let square = (i as f32 - x).powi(2) + (j as f32 - y).powi(2);
        let (size, angle) = gradient(image, i, j);
        let bin = (angle / TAU * BINS as f32).round().rem_euclid(BINS as f32) as usize % BINS;
        raw[bin] += size * (-0.5 * square / (window * window)).exp();
    }
    let at = |i: usize, by: usize| raw[(i + BINS + by - 2) % BINS];
    let smooth: [f32; BINS] =
        std::array::from_fn(|i| (at(i, 0) + at(i, 4)) / 16.0 + (at(i, 1) + at(i, 3)) / 4.0 + at(i, 2) * 0.375);
    let most = smooth.iter().copied().fold(0.0, f32::max);
    let peak = |i: usize| {
        let (before, here, after) = (smooth[(i + BINS - 1) % BINS], smooth[i], smooth[(i + 1) % BINS]);
        let high = here > before && here > after && here >= PEAK * most;
        high.then(|| (i as f32 + 0.5 * (before - after) / (before - 2.0 * here + after)) / BINS as f32 * TAU)
    };
    (0..BINS).filter_map(peak).collect()
}

/// Histograms of gradients in 4 x 4 cells, turned with the keypoint; the square roots of the normalized numbers.
pub(crate) fn describe(image: &Gray, x: f32, y: f32, sigma: f32, angle: f32) -> [f32; DESCRIPTOR] {
    let mut histogram = [0.0_f32; DESCRIPTOR];
    let (sin, cos) = angle.sin_cos();
    let cell = CELL * sigma;
    let half = 0.5 * CELLS as f32;
    let radius = cell * (half + 0.5) * std::f32::consts::SQRT_2;
    for (i, j) in around(image, x, y, radius) {
        let (dx, dy) = (i as f32 - x, j as f32 - y);
        let (u, v) = ((cos * dx + sin * dy) / cell, (cos * dy - sin * dx) / cell);
        let (column, row) = (u + half - 0.5, v + half - 0.5);
        if column <= -1.0 || row <= -1.0 || column >= CELLS as f32 || row >= CELLS as f32 {
            continue;
        }
        let (size, direction) = gradient(image, i, j);
        let weight = size * (-0.5 * (u * u + v * v) / (half * half)).exp();
        let turned = ((direction - angle) / TAU * DIRECTIONS as f32).rem_euclid(DIRECTIONS as f32);
        let (left, top, bin) = (column.floor(), row.floor(), turned.floor());
        let parts = [column - left, row - top, turned - bin];
        for corner in 0..8 {
            let next = |k: usize| (corner >> k & 1) as f32;
            let (c, r) = (left + next(0), top + next(1));
            if c < 0.0 || r < 0.0 || c >= CELLS as f32 || r >= CELLS as f32 {
                continue;
            }
            let part = |k: usize| if corner >> k & 1 == 1 { parts[k] } else { 1.0 - parts[k] };
            let b = (bin + next(2)) as usize % DIRECTIONS;
            histogram[(r as usize * CELLS + c as usize) * DIRECTIONS + b] += weight * part(0) * part(1) * part(2);
        }
    }
    let length = histogram.iter().map(|h| h * h).sum::<f32>().sqrt().max(f32::MIN_POSITIVE);
    histogram.iter_mut().for_each(|h| *h = h.min(LARGEST * length));
    let sum = histogram.iter().sum::<f32>().max(f32::MIN_POSITIVE);
    histogram.map(|h| (h / sum).sqrt())
}
