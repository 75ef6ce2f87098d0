//! Principal components.

use weaver_kernels::dense::symmetric_eigen;
use weaver_kernels::{Real, parallel};

/// Points in one partial sum of products: few enough to stay in a cache.
const BLOCK: usize = 256;
/// Rounds of rotations; ten are enough for hundreds of channels.
const MOST_SWEEPS: usize = 60;
/// Part of the largest deviation below which deviations are rounding errors of `f32`.
const ROUNDING: f64 = 1e-6;

/// The directions of largest variance of points.
///
/// Axes are eigenvectors of the covariance, largest variance first, each with its largest component positive.
///
/// ```
/// use weaver_lift::Pca;
/// let pca = Pca::of(&[0.0, 0.0, 1.0, 2.0, 2.0, 4.0], 2, 1);
/// assert!((pca.axes[1] / pca.axes[0] - 2.0).abs() < 1e-12);
/// assert!((pca.project(&[2.0, 4.0])[0] - 5.0_f64.sqrt()).abs() < 1e-12);
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct Pca {
    /// The mean of the points, `[F]`.
    pub mean: Vec<f64>,
    /// Unit vectors, `[components, F]`.
    pub axes: Vec<f64>,
    /// Variance along each axis, with N - 1 in the denominator, `[components]`.
    pub variances: Vec<f64>,
}

impl Pca {
    /// The first `components` axes of `points` `[N, channels]`, or all there are. Time grows with N F^2 + F^3.
    pub fn of<T: Real>(points: &[T], channels: usize, components: usize) -> Self {
        let count = points.len() / channels.max(1);
        let mut mean = vec![0.0; channels];
        for point in points.chunks_exact(channels.max(1)) {
            mean.iter_mut().zip(point).for_each(|(sum, x)| *sum += x.to_f64());
        }
        mean.iter_mut().for_each(|sum| *sum /= count.max(1) as f64);
        let mut covariance = vec![0.0; channels * channels];
        for points in points.chunks((BLOCK * channels).max(1)) {
            let centered: Vec<f64> = points.iter().enumerate().map(|(i, x)| x.to_f64() - mean[i % channels]).collect();
            parallel::for_chunks(&mut covariance, channels, |i, row| {
                for point in centered.chunks_exact(channels) {
                    row.iter_mut().zip(point).for_each(|(sum, x)| *sum += point[i] * x);
                }
            });
        }
        covariance.iter_mut().for_each(|x| *x /= count.max(2) as f64 - 1.0);
        let square = |at: usize| covariance[at] * covariance[at];
        let rounding = (0..channels * channels).map(square).sum::<f64>() * f64::EPSILON * f64::EPSILON;
        let settled = |a: &[f64]| {
            let below = (0..channels).flat_map(|i| (0..i).map(move |j| i * channels + j));
            below.map(|at| a[at] * a[at]).sum::<f64>() <= rounding
        };
        let mut vectors = vec![0.0; channels * channels];
        symmetric_eigen(&mut covariance, &mut vectors, MOST_SWEEPS, settled);
        let values: Vec<f64> = (0..channels).map(|i| covariance[i * channels + i]).collect();
        let mut order: Vec<usize> = (0..channels).collect();
        order.sort_by(|a, b| values[*b].total_cmp(&values[*a]));
        order.truncate(components);
        let mut axes = Vec::with_capacity(order.len() * channels);
        for &at in &order {
            let axis = &vectors[at * channels..(at + 1) * channels];
            let largest = axis.iter().fold(0.0_f64, |most, x| if x.abs() > most.abs() { *x } else { most });
            axes.extend(axis.iter().map(|x| x * largest.signum()));
        }
        Self { mean, axes, variances: order.iter().map(|at| values[*at].max(0.0)).collect() }
    }

    /// Drops the axes with variances of rounding size.
    pub(crate) fn drop_rounding(&mut self) {
        let least = ROUNDING * ROUNDING * self.variances.first().copied().unwrap_or(0.0);
        let kept = self.variances.iter().take_while(|variance| **variance > least).count();
        self.axes.truncate(kept * self.mean.len());
        self.variances.truncate(kept);
    }

    /// Number of axes.
    pub fn components(&self) -> usize {
        self.variances.len()
    }

    /// Coordinates of `points` `[N, F]` along the axes, from the mean: `[N, components]`.
    pub fn project<T: Real>(&self, points: &[T]) -> Vec<f64> {
        let (channels, components) = (self.mean.len().max(1), self.components());
        let mut out = vec![0.0; points.len() / channels * components];
        parallel::for_chunks(&mut out, (BLOCK * components).max(1), |chunk, out| {
            let points = points[chunk * BLOCK * channels..].chunks_exact(channels);
            for (out, point) in out.chunks_exact_mut(components).zip(points) {
                for (x, axis) in out.iter_mut().zip(self.axes.chunks_exact(channels)) {
                    let terms = point.iter().zip(&self.mean).zip(axis);
                    *x = terms.map(|((x, mean), axis)| (x.to_f64() - mean) * axis).sum();
                }
            }
        });
        out
    }
}
