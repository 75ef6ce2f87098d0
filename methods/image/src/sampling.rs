//! Random pixels, and the published placement of Gaussians.

use crate::picture::Picture;
use crate::window::Window;
use weaver_kernels::random::Stream;

/// Most candidates of a round of the published exclusion sampling, and its rounds.
const CANDIDATES: usize = 10_000;
const ROUNDS: u64 = 50;
/// Bounds of weights, and the parts of gradient and variance in them.
const LEAST_WEIGHT: f64 = 1e-8;
const GRADIENT: f64 = 0.9;

/// Draws indices without replacement, proportionally to weights, in ascending order.
///
/// The smallest of the exponential numbers `-ln(u) / weight` are taken (Efraimidis and Spirakis, 2006). Weights of 0
/// are drawn last.
pub fn weighted_sample(weights: &[f64], count: usize, stream: Stream) -> Vec<usize> {
    let count = count.min(weights.len());
    if count == 0 {
        return Vec::new();
    }
    let key = |(i, weight): (usize, &f64)| (-stream.uniform::<f64>(i as u64).ln() / weight, i);
    let mut keys: Vec<(f64, usize)> = weights.iter().enumerate().map(key).collect();
    keys.select_nth_unstable_by(count - 1, |a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
    let mut chosen: Vec<usize> = keys[..count].iter().map(|key| key.1).collect();
    chosen.sort_unstable();
    chosen
}

/// The published weights of the pixels of a window: `max(1e-8, 0.9 m + 0.1 v)`, m the Sobel magnitude of the mean of
/// channels, v the variance over 5 x 5 pixels, mean of channels, each divided by its largest.
///
/// The picture is extended beyond the window by its border pixels: zeros would make the frame an edge.
pub fn weights(picture: &Picture, window: Window) -> Vec<f64> {
    let clamp = |x: isize, first: usize, length: usize| (x.max(0) as usize).min(length - 1) + first;
    let color = |x: isize, y: isize| {
        let pixel = clamp(y, window.y, window.height) * picture.width + clamp(x, window.x, window.width);
        [0, 1, 2].map(|c| f64::from(picture.colors[3 * pixel + c]))
    };
    let gray = |x, y| color(x, y).iter().sum::<f64>() / 3.0;
    let (mut slopes, mut variances) = (Vec::new(), Vec::new());
    for y in 0..window.height as isize {
        for x in 0..window.width as isize {
            let g = |dx: isize, dy: isize| gray(x + dx, y + dy);
            let along = |a: [f64; 3], b: [f64; 3]| (a[0] - b[0]) + 2.0 * (a[1] - b[1]) + (a[2] - b[2]);
            let (right, left) = ([g(1, -1), g(1, 0), g(1, 1)], [g(-1, -1), g(-1, 0), g(-1, 1)]);
            let (below, above) = ([g(-1, 1), g(0, 1), g(1, 1)], [g(-1, -1), g(0, -1), g(1, -1)]);
            slopes.push(along(right, left).hypot(along(below, above)));
            let (mut sums, mut squares) = ([0.0; 3], [0.0; 3]);
            for (dx, dy) in (0..25).map(|k| (k % 5 - 2, k / 5 - 2)) {
                for (c, value) in color(x + dx, y + dy).into_iter().enumerate() {
                    sums[c] += value;
                    squares[c] += value * value;
                }
            }
            let variance = |c: usize| (squares[c] / 25.0 - (sums[c] / 25.0).powi(2)).max(0.0);
            variances.push((variance(0) + variance(1) + variance(2)) / 3.0);
        }
    }
    let largest = |of: &[f64]| of.iter().fold(f64::MIN_POSITIVE, |most, x| most.max(*x));
    let (slope, variance) = (largest(&slopes), largest(&variances));
    let weight = |(m, v): (&f64, &f64)| (GRADIENT * m / slope + (1.0 - GRADIENT) * v / variance).max(LEAST_WEIGHT);
    slopes.iter().zip(&variances).map(weight).collect()
}

/// Adds up to `count` uniform points of a window that lie farther than `distance` from all earlier points and rounds;
/// points of one round may be near each other. There may be fewer. Returns the number of points after each round.
pub fn exclude(points: &mut Vec<[f32; 2]>, count: usize, window: Window, distance: f32, stream: Stream) -> Vec<usize> {
    let mut near = Near::new(window, distance);
    points.iter().for_each(|point| near.insert(*point));
    let end = points.len() + count;
    let mut ends = Vec::new();
    for round in 0..ROUNDS {
        let random = stream.fork(round);
        let first = points.len();
        if first == end {
            break;
        }
        for i in 0..CANDIDATES as u64 {
            let at = |axis: u64, from: usize, length: usize| {
                from as f32 + length as f32 * random.uniform::<f32>(2 * i + axis)
            };
            let point = [at(0, window.x, window.width), at(1, window.y, window.height)];
            if !near.holds(point) {
                points.push(point);
                if points.len() == end {
                    break;
                }
            }
        }
        points[first..].iter().for_each(|point| near.insert(*point));
        ends.push(points.len());
    }
    ends
}

/// Points by square cells with a distance as their side.
struct Near {
    window: Window,
    distance: f32,
    cell: f32,
    columns: usize,
    cells: Vec<Vec<[f32; 2]>>,
}

impl Near {
    fn new(window: Window, distance: f32) -> Self {
        let cell = distance.max(1.0);
        let cells = |side: usize| (side as f32 / cell) as usize + 1;
        let (columns, rows) = (cells(window.width), cells(window.height));
        Self { window, distance, cell, columns, cells: vec![Vec::new(); columns * rows] }
    }

    fn cell(&self, point: [f32; 2]) -> [usize; 2] {
        let along = |x: f32, first: usize| ((x - first as f32).max(0.0) / self.cell) as usize;
        let rows = self.cells.len() / self.columns;
        [along(point[0], self.window.x).min(self.columns - 1), along(point[1], self.window.y).min(rows - 1)]
    }

    fn insert(&mut self, point: [f32; 2]) {
        let [x, y] = self.cell(point);
        self.cells[y * self.columns + x].push(point);
    }

    /// True if a point lies within the distance.
    fn holds(&self, point: [f32; 2]) -> bool {
        let [x, y] = self.cell(point);
        let rows = self.cells.len() / self.columns;
        let around = |at: usize, end: usize| at.saturating_sub(1)..(at + 2).min(end);
        around(y, rows).any(|y| {
            around(x, self.columns).any(|x| {
                let here = &self.cells[y * self.columns + x];
                here.iter().any(|p| (p[0] - point[0]).hypot(p[1] - point[1]) <= self.distance)
            })
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn samples_are_drawn_once_and_by_weight() {
        let weights: Vec<f64> = (0..100).map(|i| if i % 2 == 0 { 1.0 } else { 0.0 }).collect();
        let drawn = weighted_sample(&weights, 50, Stream::new(1, 0, "test"));
        assert_eq!(drawn, (0..100).step_by(2).collect::<Vec<_>>());
        assert_eq!(weighted_sample(&weights, 1000, Stream::new(1, 0, "test")).len(), 100);
        // One of two: 0.9 of the time the heavier one.
        let heavier = |seed| weighted_sample(&[0.1, 0.9], 1, Stream::new(seed, 0, "test"))[0];
        let share = (0..4000).map(heavier).sum::<usize>() as f64 / 4000.0;
        assert!((share - 0.9).abs() < 0.02, "{share}");
    }

    #[test]
    fn the_frame_of_a_constant_picture_has_no_weight() {
        let picture = Picture::new(12, 9, vec![0.7; 12 * 9 * 3]).unwrap();
        let window = Window { x: 2, y: 1, width: 8, height: 7 };
        assert!(weights(&picture, window).iter().all(|w| *w < 1e-6));
    }

    #[test]
    fn exclusion_holds_across_rounds() {
        let window = Window { x: 10, y: 0, width: 120, height: 90 };
        let mut points = vec![[50.0, 50.0], [60.5, 20.0]];
        let rounds = exclude(&mut points, 40_000, window, 1.5, Stream::new(3, 0, "test"));
        assert!(rounds.len() > 2 && points.len() < 40_000);
        let mut first = 0;
        for end in rounds {
            for new in &points[first.max(2)..end] {
                let old = &points[..first.max(2)];
                assert!(old.iter().all(|old| (old[0] - new[0]).hypot(old[1] - new[1]) > 1.5));
            }
            first = end;
        }
    }
}
