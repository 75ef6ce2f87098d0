//! Depth of a network brought to points whose depth is known.

use rayon::prelude::*;

/// Views with fewer points are corrected as all views together are.
const FEWEST: usize = 5;
/// Weight of the median of all views, in points, against a view's own points.
const PRIOR_POINTS: f64 = 5.0;
/// Views with fewer points get no line in the logarithm of depth.
const FEWEST_FOR_LINE: usize = 12;
/// Added to the standard deviation of ln d that the line's variable is divided by: where a view is flat, no slope
/// shows.
const LEAST_SPREAD: f64 = 0.05;
/// Weights of the squares of the line's offset and slope, in points.
const RIDGE: [f64; 2] = [1.0, 5.0];
/// Solutions of the line, each with weights by the remainders of the one before.
const ROUNDS: usize = 5;
/// Differences of logarithms beyond which a point says less and less about the line.
const LINE_SCALE: f64 = 0.1;
/// The line ends this many (widened) standard deviations of the points' ln d from their mean.
const LINE_REACH: f64 = 3.0;
/// Limit on the influence of a point on its surroundings.
const REST_LIMIT: f64 = 0.5;
/// Standard deviation of the surroundings of a point across the image, pixels; tried at 64 x 48.
const REST_PIXELS: f64 = 5.0;
/// Standard deviation of the surroundings of a point in ln d: a point says nothing about surfaces behind or before it.
const REST_LOG_DEPTH: f64 = 0.25;
/// The largest correction: a factor of 4.5.
const LIMIT: f64 = 1.5;

/// A point as a photo shows it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SeenPoint {
    /// Where, in pixels from the left and upper border; centers of pixels are at .5.
    pub pixel: [f64; 2],
    /// Depth along the optical axis, in the units of the network's depth once that is corrected.
    pub depth: f64,
}

/// Correction of depth to the points that the views show.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct DepthCorrection {
    /// L `[V, H, W]`: depth is to be multiplied by exp(L).
    pub log_factors: Vec<f32>,
    /// Number of points that each view's correction rests on.
    pub points: Vec<usize>,
}

impl DepthCorrection {
    /// Factors on depth, exp(L) `[V, H, W]`.
    pub fn factors(&self) -> Vec<f32> {
        self.log_factors.iter().map(|l| l.exp()).collect()
    }
}

/// The factors that bring depth `[V, H, W]` of a network to points of known depth, a list for each view.
///
/// With d the network's depth at a point, z the point's, e = ln z - ln d, g the median of e over all views, and n the
/// number of the view's points, a view with fewer than 5 points gets L = g. All others begin with
///
/// ```text
/// a = (n median(e) + 5 g) / (n + 5)
/// ```
///
/// and get, from 12 points on, a line in s = (ln d - mean) / (deviation + 0.05), mean and standard deviation over the
/// points: L = a + q0 + q1 s, s within 3, where q minimizes `sum w (e - a - q0 - q1 s)^2 + q0^2 + 5 q1^2` with w = 1 /
/// (1 + (r / 0.1)^2) by the remainders r of the last of five rounds. The remainder at the points, within 0.5, is spread
/// over similar depth:
///
/// ```text
/// L += sum(w rest) / (1 + sum w),   w = exp(-|pixels apart|^2 / 50 - (difference of ln d)^2 / 0.125)
/// ```
///
/// and L is kept within 1.5. No points leave depth as it is. Points outside of the image or without a positive depth,
/// and points where the network's depth is not positive, do not count. Every L is finite. The order of points changes
/// rounding alone. It takes time in proportion to pixels times points. Our own method; its constants are first guesses,
/// tried on real captures at 64 x 48.
///
/// # Panics
/// If `depth` is not of `seen.len()` images of `height` x `width`.
///
/// ```
/// use weaver_inference::{SeenPoint, depth_to_points};
///
/// // The network takes everything for half as far away as it is.
/// let depth = [1.0; 12 * 16];
/// let at = |i: usize| SeenPoint { pixel: [(i % 8) as f64 * 2.0 + 0.5, (i / 8) as f64 * 4.0 + 0.5], depth: 2.0 };
/// let correction = depth_to_points(&depth, [12, 16], &[(0..24).map(at).collect::<Vec<_>>()]);
/// assert!(correction.log_factors.iter().all(|l| (l - 2f32.ln()).abs() < 1e-6));
/// ```
pub fn depth_to_points(depth: &[f32], [height, width]: [usize; 2], seen: &[Vec<SeenPoint>]) -> DepthCorrection {
    let plane = height * width;
    assert_eq!(depth.len(), seen.len() * plane, "depth of as many views as there are lists of points");
    let maps: Vec<Vec<f64>> = (0..seen.len()).map(|v| log_depth(&depth[v * plane..][..plane])).collect();
    let views: Vec<Vec<Sample>> =
        maps.iter().zip(seen).map(|(map, seen)| samples(map, [height, width], seen)).collect();
    let global = median(views.iter().flatten().map(|sample| sample.error)).unwrap_or(0.0);
    let mut log_factors = vec![0.0; depth.len()];
    for (v, view) in views.iter().enumerate() {
        let out = &mut log_factors[v * plane..][..plane];
        if view.len() < FEWEST {
            out.fill(global.clamp(-LIMIT, LIMIT) as f32);
        } else {
            correct(out, &maps[v], width, view, global);
        }
    }
    DepthCorrection { log_factors, points: views.iter().map(Vec::len).collect() }
}

/// A point that counts.
#[derive(Clone, Copy, Debug)]
struct Sample {
    pixel: [f64; 2],
    /// ln d.
    log_depth: f64,
    /// ln z - ln d.
    error: f64,
}

/// Logarithms of a view's depth; where it has none, not a number.
fn log_depth(depth: &[f32]) -> Vec<f64> {
    depth.iter().map(|d| if *d > 0.0 && d.is_finite() { f64::from(*d).ln() } else { f64::NAN }).collect()
}

fn samples(map: &[f64], [height, width]: [usize; 2], seen: &[SeenPoint]) -> Vec<Sample> {
    let sample = |point: &SeenPoint| {
        let [x, y] = point.pixel;
        let inside = x >= 0.0 && x < width as f64 && y >= 0.0 && y < height as f64;
        let log_depth = inside.then(|| map[y as usize * width + x as usize])?;
        let error = point.depth.ln() - log_depth;
        error.is_finite().then_some(Sample { pixel: point.pixel, log_depth, error })
    };
    seen.iter().filter_map(sample).collect()
}

/// The mean of the two middle values of an even number; `None` of none.
fn median(values: impl Iterator<Item = f64>) -> Option<f64> {
    let mut sorted: Vec<f64> = values.collect();
    sorted.sort_unstable_by(f64::total_cmp);
    let n = sorted.len();
    (n > 0).then(|| (sorted[(n - 1) / 2] + sorted[n / 2]) / 2.0)
}

/// The log factors of a view with enough points.
fn correct(out: &mut [f32], map: &[f64], width: usize, view: &[Sample], global: f64) {
    let n = view.len() as f64;
    let own = median(view.iter().map(|sample| sample.error)).unwrap_or(global);
    let offset = (n * own + PRIOR_POINTS * global) / (n + PRIOR_POINTS);
    let line = Line::fit(view, offset);
    let rest: Vec<f64> = view.iter().map(|s| (s.error - line.at(s.log_depth)).clamp(-REST_LIMIT, REST_LIMIT)).collect();
    out.par_iter_mut().enumerate().for_each(|(i, out)| {
        let log_depth = if map[i].is_nan() { line.mean } else { map[i] };
        let center = [(i % width) as f64 + 0.5, (i / width) as f64 + 0.5];
        let (mut sum, mut weights) = (0.0, 1.0);
        for (sample, rest) in view.iter().zip(&rest) {
            let apart: f64 = (0..2).map(|k| (center[k] - sample.pixel[k]).powi(2)).sum();
            let deeper = log_depth - sample.log_depth;
            let distance = apart / REST_PIXELS.powi(2) + (deeper / REST_LOG_DEPTH).powi(2);
            let weight = (-distance / 2.0).exp();
            sum += weight * rest;
            weights += weight;
        }
        *out = (line.at(log_depth) + sum / weights).clamp(-LIMIT, LIMIT) as f32;
    });
}

/// A correction that depends on ln d alone: `offset + slope s`.
#[derive(Clone, Copy, Debug)]
struct Line {
    offset: f64,
    slope: f64,
    mean: f64,
    spread: f64,
}

impl Line {
    /// A constant of few points, else a line that outliers hardly move.
    fn fit(view: &[Sample], offset: f64) -> Self {
        let n = view.len() as f64;
        let mean = view.iter().map(|s| s.log_depth).sum::<f64>() / n;
        let variance = view.iter().map(|s| (s.log_depth - mean).powi(2)).sum::<f64>() / n;
        let flat = Self { offset, slope: 0.0, mean, spread: variance.sqrt() + LEAST_SPREAD };
        if view.len() < FEWEST_FOR_LINE {
            return flat;
        }
        let mut line = flat;
        for _ in 0..ROUNDS {
            // Normal equations [a b; b c] q = [u; v].
            let ([mut a, mut b, mut c], [mut u, mut v]) = ([RIDGE[0], 0.0, RIDGE[1]], [0.0; 2]);
            for sample in view {
                let s = line.variable(sample.log_depth);
                let weight = 1.0 / (1.0 + ((sample.error - line.at(sample.log_depth)) / LINE_SCALE).powi(2));
                let error = sample.error - offset;
                a += weight;
                b += weight * s;
                c += weight * s * s;
                u += weight * error;
                v += weight * s * error;
            }
            let determinant = a * c - b * b;
            line.offset = offset + (c * u - b * v) / determinant;
            line.slope = (a * v - b * u) / determinant;
        }
        line
    }

    /// s.
    fn variable(&self, log_depth: f64) -> f64 {
        ((log_depth - self.mean) / self.spread).clamp(-LINE_REACH, LINE_REACH)
    }

    fn at(&self, log_depth: f64) -> f64 {
        self.offset + self.slope * self.variable(log_depth)
    }
}
