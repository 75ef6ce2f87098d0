//! Initial Gaussians of a fit.

use crate::gaussians::{Gaussians, LEAST_SCALE};
use crate::picture::Picture;
use crate::quadtree::quadtree;
use crate::sampling::{exclude, weighted_sample, weights};
use crate::window::Window;
use std::f32::consts::PI;
use weaver_kernels::nearest_neighbors::nearest_neighbors;
use weaver_kernels::order::median_high;
use weaver_kernels::random::Stream;

/// Initial Gaussians of a fit.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum Start {
    /// Uniform positions, standard deviations from 0.5 to 1.5 pixels, colors from 0 to 1.
    Random,
    /// Published positions, the rest as [`Random`](Self::Random).
    Positions,
    /// Published positions and scales, the rest as [`Random`](Self::Random).
    Scales,
    /// The published one: positions by gradients and variances, then far from others, scales by weights and neighbors,
    /// colors by weighted medians.
    Published,
    /// A Gaussian in each cell of a [`quadtree()`]: standard deviations half of its sides, its mean color.
    Quadtree,
}

/// Sides of the parts in which the published method places Gaussians one after another.
const PART: usize = 1024;
/// Share of the Gaussians drawn by weight.
const BY_WEIGHT: f64 = 0.7;
/// Half the samples of a median along an axis.
const SAMPLES: i32 = 4;

/// Places `count` Gaussians; the published exclusion sampling may place fewer.
pub fn start(picture: &Picture, count: usize, kind: Start, seed: u64) -> Gaussians<f32> {
    if kind == Start::Quadtree {
        return from_quadtree(picture, count);
    }
    let stream = Stream::new(seed, 0, "image.start");
    let uniform = |i: usize, k: u64| stream.uniform::<f32>(8 * i as u64 + k);
    let side = [picture.width, picture.height].map(|side| side as f32);
    let (positions, scales) = match kind {
        Start::Random => ((0..count).map(|i| [side[0] * uniform(i, 0), side[1] * uniform(i, 1)]).collect(), vec![]),
        _ => published(picture, count, stream),
    };
    let mut out = Gaussians::default();
    for (i, center) in positions.into_iter().enumerate() {
        let scale = match kind {
            Start::Scales | Start::Published => [scales[i]; 2],
            _ => [0.5 + uniform(i, 2), 0.5 + uniform(i, 3)],
        };
        let color = match kind {
            Start::Published => median(picture, center, scale[0]),
            _ => [4, 5, 6].map(|k| uniform(i, k)),
        };
        // The published angle, 2 pi sigmoid(0).
        out.push(center, scale, PI, color);
    }
    out
}

fn from_quadtree(picture: &Picture, count: usize) -> Gaussians<f32> {
    let mut out = Gaussians::default();
    for leaf in quadtree(picture, count) {
        let Window { x, y, width, height } = leaf.cell;
        let scale = [width, height].map(|side| 0.5 * side as f32);
        out.push([x as f32 + scale[0], y as f32 + scale[1]], scale, 0.0, leaf.mean);
    }
    out
}

/// Published positions and scales.
fn published(picture: &Picture, count: usize, stream: Stream) -> (Vec<[f32; 2]>, Vec<f32>) {
    // All parts have the same size; the last ones begin earlier, over their neighbors.
    let firsts = |side: usize| (0..side.div_ceil(PART)).map(move |i| (i * PART).min(side.saturating_sub(PART)));
    let parts: Vec<[usize; 2]> =
        firsts(picture.height).flat_map(|y| firsts(picture.width).map(move |x| [x, y])).collect();
    let (mut positions, mut scales) = (Vec::new(), Vec::new());
    for (i, [x, y]) in parts.iter().copied().enumerate() {
        let window = Window { x, y, width: picture.width.min(PART), height: picture.height.min(PART) };
        // Shares are equal, independent of the content; the first ones have the remainder.
        let share = count / parts.len() + usize::from(i < count % parts.len());
        let (own, sizes) = part(picture, window, share, stream.fork(i as u64));
        positions.extend(own);
        scales.extend(sizes);
    }
    (positions, scales)
}

fn part(picture: &Picture, window: Window, count: usize, stream: Stream) -> (Vec<[f32; 2]>, Vec<f32>) {
    let base = (window.pixels() as f32 / (PI * count.max(1) as f32)).sqrt() / 3.0;
    let weights = weights(picture, window);
    let drawn = weighted_sample(&weights, (BY_WEIGHT * count as f64) as usize, stream.fork(0));
    let middle = |p: usize| [(window.x + p % window.width) as f32 + 0.5, (window.y + p / window.width) as f32 + 0.5];
    let mut positions: Vec<[f32; 2]> = drawn.iter().map(|p| middle(*p)).collect();
    let mut scales: Vec<f32> = drawn.iter().map(|p| base * (-0.5 * weights[*p] as f32).exp()).collect();
    let mut sorted = scales.clone();
    let median = median_high(&mut sorted).unwrap_or(base);
    exclude(&mut positions, count - drawn.len(), window, base.max(median), stream.fork(1));
    if positions.len() < 3 {
        scales.resize(positions.len(), base);
        return (positions, scales);
    }
    let points: Vec<f32> = positions.iter().flat_map(|p| [p[0], p[1], 0.0]).collect();
    let mut neighbors = vec![0; 3 * positions.len()];
    nearest_neighbors(&points, 2, &mut neighbors);
    for i in drawn.len()..positions.len() {
        let square = |j: u32| {
            let [a, b] = [positions[i], positions[j as usize]];
            (a[0] - b[0]).powi(2) + (a[1] - b[1]).powi(2)
        };
        // Of the three neighbors, the first is the point itself, as published.
        let scale = ((square(neighbors[3 * i + 1]) + square(neighbors[3 * i + 2])) / 3.0).sqrt();
        scales.push(scale.max(LEAST_SCALE));
    }
    (positions, scales)
}

/// The published color: a weighted median of 9 x 9 samples out to the standard deviation. Weights take distances in
/// samples and the deviation in pixels, as published.
fn median(picture: &Picture, center: [f32; 2], scale: f32) -> [f32; 3] {
    let mut samples: Vec<([f32; 3], f32)> = Vec::new();
    for (i, j) in (-SAMPLES..=SAMPLES).flat_map(|i| (-SAMPLES..=SAMPLES).map(move |j| (i as f32, j as f32))) {
        let offset = |k: f32| scale * k / SAMPLES as f32;
        let color = picture.at(center[0] + offset(i), center[1] + offset(j));
        samples.push((color, (-(i * i + j * j) / (2.0 * scale * scale)).exp()));
    }
    let half = 0.5 * samples.iter().map(|sample| sample.1).sum::<f32>();
    std::array::from_fn(|c| {
        samples.sort_by(|a, b| a.0[c].total_cmp(&b.0[c]));
        let mut sum = 0.0;
        let middle = samples.iter().find(|sample| {
            sum += sample.1;
            sum >= half
        });
        middle.map_or(0.0, |sample| sample.0[c])
    })
}
