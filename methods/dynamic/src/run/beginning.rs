//! Initial Gaussians of experts.

use crate::run::RunError;
use weaver_data::film::{Film, FilmPoint};
use weaver_geometry::glam::{DMat3, DVec2, DVec3};
use weaver_kernels::nearest_neighbors::nearest_neighbors;
use weaver_kernels::order::median_high;
use weaver_kernels::random::Stream;

/// Initial Gaussians, with the time of each observation.
#[derive(Clone, Debug, Default)]
pub struct Beginning {
    /// Centers `[N, 3]`.
    pub positions: Vec<f64>,
    /// Standard deviations `[N]`.
    pub sizes: Vec<f64>,
    /// Colors `[N, 3]`.
    pub colors: Vec<f64>,
    /// Times `[N]`.
    pub times: Vec<f64>,
}

/// Neighbors whose mean distance is a Gaussian's size.
const NEIGHBORS: usize = 3;
/// Sizes are at least this share of the film's extent.
const SMALLEST: f64 = 1e-3;
/// Range of initial depths without points, in distances to the cameras' common focus.
const BETWEEN: [f64; 2] = [0.5, 1.5];

impl Beginning {
    /// `count` of a film's points; if there are too few, further ones under random pixels at random depths.
    ///
    /// # Errors
    /// When a photo cannot be read any more.
    pub fn of(film: &Film, count: usize, stream: Stream) -> Result<Self, RunError> {
        let order = stream.fork(0).permutation(film.points.len());
        let mut points: Vec<FilmPoint> = order.iter().take(count).map(|i| film.points[*i]).collect();
        let missing = count - points.len();
        points.extend(somewhere(film, missing, stream.fork(1))?);
        Ok(Self::at(&points, film.extent()))
    }

    fn at(points: &[FilmPoint], extent: f64) -> Self {
        let positions: Vec<f64> = points.iter().flat_map(|point| point.position.to_array()).collect();
        let sizes = sizes(&positions, SMALLEST * extent);
        let colors = points.iter().flat_map(|point| point.color.map(f64::from)).collect();
        Self { positions, sizes, colors, times: points.iter().map(|point| point.time).collect() }
    }

    /// N placeholder Gaussians, for values that are about to be read.
    pub fn blank(count: usize) -> Self {
        let positions = (0..3 * count).map(|i| i as f64).collect();
        Self { positions, sizes: vec![1.0; count], colors: vec![0.5; 3 * count], times: vec![0.5; count] }
    }
}

/// The mean distance to the nearest neighbors.
fn sizes(positions: &[f64], least: f64) -> Vec<f64> {
    let n = positions.len() / 3;
    let k = NEIGHBORS.min(n.saturating_sub(1));
    let mut rows = vec![0; n * (k + 1)];
    nearest_neighbors(positions, k, &mut rows);
    let at = |i: usize| DVec3::from_slice(&positions[3 * i..]);
    let mean = |(i, row): (usize, &[u32])| {
        let sum: f64 = row[1..].iter().map(|j| at(i).distance(at(*j as usize))).sum();
        (sum / k.max(1) as f64).max(least)
    };
    rows.chunks_exact(k + 1).enumerate().map(mean).collect()
}

/// Points under random pixels of training photos, around the distance of the cameras' common focus.
fn somewhere(film: &Film, count: usize, stream: Stream) -> Result<Vec<FilmPoint>, RunError> {
    let shots = film.training();
    if shots.is_empty() {
        return Ok(Vec::new());
    }
    let focus = focus(film).unwrap_or_else(|| 4.0 * film.extent());
    let [height, width] = film.size;
    // By photo, so that each is read once.
    let mut drawn: Vec<(usize, usize)> =
        (0..count).map(|i| (shots[stream.fork(i as u64).below(0, shots.len())], i)).collect();
    drawn.sort_unstable();
    let mut points = Vec::with_capacity(count);
    for of_photo in drawn.chunk_by(|a, b| a.0 == b.0) {
        let shot = &film.shots[of_photo[0].0];
        let bytes = shot.pixels.bytes()?;
        for (_, i) in of_photo {
            let stream = stream.fork(*i as u64);
            let pixel = [stream.below(1, width), stream.below(2, height)];
            let depth = focus * (BETWEEN[0] + (BETWEEN[1] - BETWEEN[0]) * stream.uniform::<f64>(3));
            let center = DVec2::new(pixel[0] as f64 + 0.5, pixel[1] as f64 + 0.5);
            let position = shot.camera.pose.inverse().apply(shot.camera.intrinsics.unproject(center, depth));
            let at = 3 * (pixel[1] * width + pixel[0]);
            let color = [0, 1, 2].map(|channel| f32::from(bytes[at + channel]) / 255.0);
            points.push((*i, FilmPoint { position, color, time: shot.time }));
        }
    }
    points.sort_unstable_by_key(|(i, _)| *i);
    Ok(points.into_iter().map(|(_, point)| point).collect())
}

/// The median distance of the cameras from the point nearest to all optical axes; `None` for parallel axes.
fn focus(film: &Film) -> Option<f64> {
    let shots = film.training();
    let axes = shots.iter().map(|&i| {
        let pose = &film.shots[i].camera.pose;
        (pose.center(), (pose.inverse().apply(DVec3::Z) - pose.center()).normalize())
    });
    let axes: Vec<(DVec3, DVec3)> = axes.collect();
    // sum of (I - d d^T)(x - c) = 0.
    let (mut matrix, mut right) = (DMat3::ZERO, DVec3::ZERO);
    for (center, axis) in &axes {
        let across = DMat3::IDENTITY - DMat3::from_cols(*axis * axis.x, *axis * axis.y, *axis * axis.z);
        matrix += across;
        right += across * *center;
    }
    if matrix.determinant().abs() < 1e-6 * (axes.len() as f64).powi(3) {
        return None;
    }
    let meeting = matrix.inverse() * right;
    let mut distances: Vec<f64> = axes.iter().map(|(center, axis)| (meeting - *center).dot(*axis)).collect();
    median_high(&mut distances).filter(|distance| *distance > 0.0)
}
