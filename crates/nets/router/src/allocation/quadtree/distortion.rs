//! The loss where so many Gaussians stand for all pixels of a cell.

use super::MOST;
use super::forest::Forest;
use crate::allocation::AllocationRequest;
use crate::cell::Cell;
use std::ops::Range;
use weaver_autograd::Real;
use weaver_kernels::parallel;

/// Color, and log depth as a fourth.
const CHANNELS: usize = 4;
/// Weight of a difference of log depth beside one of color.
const DEPTH_WEIGHT: f32 = 1.0;
/// Variance within a pixel of a slope of 1 per pixel.
const WITHIN_PIXEL: f32 = 1.0 / 12.0;
/// A cell's Gaussians reach so far beyond it on every side, in sides of the cell.
const MARGIN: f32 = 0.25;
/// Variance of even colors: among cells without detail, larger ones are divided first.
const EVEN: f32 = 1e-6;
/// Cells per parallel chunk.
const GRAIN: usize = 64;

/// The photos of a scene, as far as cells are measured by them.
pub(super) struct Picture {
    height: usize,
    width: usize,
    /// Colors and weighted log depth of each pixel.
    values: Vec<[f32; CHANNELS]>,
    /// Slope of each pixel's luma along x and y, per pixel.
    slopes: Vec<[f32; 2]>,
}

impl Picture {
    pub fn new<T: Real>(request: &AllocationRequest<'_, T>) -> Self {
        let (height, width) = (request.height, request.width);
        let plane = height * width;
        let value = |p: usize| {
            if request.inside.is_some_and(|inside| !inside[p]) {
                // Masked pixels have no say.
                return [0.0; CHANNELS];
            }
            let photo = &request.photos[p / plane * 3 * plane + p % plane..];
            let color = |c: usize| photo[c * plane].to_f64() as f32;
            let depth = request.depth.map_or(0.0, |depth| depth[p].to_f64().max(1e-6).ln() as f32);
            [color(0), color(1), color(2), DEPTH_WEIGHT * depth]
        };
        let values: Vec<_> = (0..request.pixels()).map(value).collect();
        let luma: Vec<f32> = values.iter().map(|v| 0.299 * v[0] + 0.587 * v[1] + 0.114 * v[2]).collect();
        let slope = |p: usize| {
            let along = |at: usize, end: usize, step: usize| {
                let (before, after) = (usize::from(at > 0), usize::from(at + 1 < end));
                (luma[p + after * step] - luma[p - before * step]) / (before + after).max(1) as f32
            };
            [along(p % width, width, 1), along(p / width % height, height, width)]
        };
        Self { height, width, slopes: (0..luma.len()).map(slope).collect(), values }
    }

    /// The pixels of a view in these rows and columns.
    fn pixels(
        &self,
        view: usize,
        rows: Range<usize>,
        columns: Range<usize>,
    ) -> impl Iterator<Item = (usize, usize, usize)> {
        let (height, width) = (self.height, self.width);
        rows.flat_map(move |row| {
            columns.clone().map(move |column| ((view * height + row) * width + column, row, column))
        })
    }

    /// The direction in which the luma of a cell changes most, in radians: half an angle, as it has no sign.
    fn angle(&self, view: usize, cell: Cell) -> f32 {
        let [mut xx, mut xy, mut yy] = [0.0; 3];
        for (p, ..) in self.pixels(view, cell.rows(self.height), cell.columns(self.width)) {
            let [x, y] = self.slopes[p];
            xx += x * x;
            xy += x * y;
            yy += y * y;
        }
        0.5 * (2.0 * xy).atan2(xx - yy)
    }

    fn within_pixel(&self, p: usize) -> f32 {
        let [x, y] = self.slopes[p];
        3.0 * WITHIN_PIXEL * (x * x + y * y)
    }

    /// Squared deviation from the mean of the nearest band, over all that a cell's Gaussians reach, per pixel of the
    /// cell; infinite where a band has no pixel.
    fn deviation(&self, view: usize, cell: Cell, gaussians: usize, angle: f32) -> f32 {
        let (rows, columns) = (cell.rows(self.height), cell.columns(self.width));
        let own = (rows.len() * columns.len()) as f32;
        let bands = cell.bands(gaussians, angle);
        let mut means = [[0.0; CHANNELS]; MOST];
        let mut counts = [0.0; MOST];
        for (p, row, column) in self.pixels(view, rows.clone(), columns.clone()) {
            let band = bands.of(row, column);
            counts[band] += 1.0;
            means[band].iter_mut().zip(self.values[p]).for_each(|(mean, value)| *mean += value);
        }
        if counts[..gaussians].contains(&0.0) {
            return f32::INFINITY;
        }
        for (mean, count) in means.iter_mut().zip(counts) {
            mean.iter_mut().for_each(|mean| *mean /= count);
        }
        let margin = (MARGIN * cell.side() as f32) as usize;
        let wider = |range: Range<usize>, end: usize| range.start.saturating_sub(margin)..(range.end + margin).min(end);
        let (rows, columns) = (wider(rows, self.height), wider(columns, self.width));
        let reached = (rows.len() * columns.len()) as f32;
        let mut sum = 0.0;
        for (p, row, column) in self.pixels(view, rows, columns) {
            let mean = means[bands.of(row, column)];
            let deviation =
                mean.iter().zip(self.values[p]).map(|(mean, value)| (value - mean) * (value - mean)).sum::<f32>();
            sum += deviation + self.within_pixel(p);
        }
        (sum / reached + EVEN * own.sqrt()) * own
    }

    /// The angle of each node, and its loss with 0 to `most` Gaussians `[nodes, 1 + most]`; without any, infinite.
    pub fn measure(&self, forest: &Forest, most: usize) -> (Vec<f32>, Vec<f32>) {
        let mut nodes = vec![(0.0, [f32::INFINITY; 1 + MOST]); forest.nodes()];
        parallel::for_chunks(&mut nodes, GRAIN, |chunk, nodes| {
            for (i, (angle, losses)) in nodes.iter_mut().enumerate() {
                let (view, cell) = forest.cell(GRAIN * chunk + i);
                *angle = self.angle(view, cell);
                for (e, loss) in losses.iter_mut().enumerate().take(1 + most).skip(1) {
                    *loss = match cell.level {
                        // For bands thinner than the pixel, only its slope is known.
                        0 => {
                            let p = (view * self.height + cell.row) * self.width + cell.column;
                            self.within_pixel(p) / (e * e) as f32
                        }
                        _ => self.deviation(view, cell, e, *angle),
                    };
                }
            }
        });
        let losses = nodes.iter().flat_map(|(_, losses)| losses[..=most].iter().copied()).collect();
        (nodes.iter().map(|(angle, _)| *angle).collect(), losses)
    }
}
