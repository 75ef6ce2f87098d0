//! K-means.

use weaver_kernels::random::Stream;

/// Bound on the rounds; K-means ends earlier when no point changes its cluster.
const ROUNDS: usize = 100;
/// Random initializations; the best result is taken.
const TRIES: u64 = 8;

/// The centers `[k, width]` of clusters of points `[N, width]` with the least sum of squared distances among several
/// initializations, each spread out at random (Arthur and Vassilvitskii, 2007) and improved until no point changes its
/// cluster (Lloyd).
///
/// There are at most as many centers as different points.
///
/// ```
/// use weaver_vad::{cluster_centers, nearest_center};
/// let centers = cluster_centers(&[0.0, 0.1, 5.0, 5.1], 1, 2, 0);
/// assert_ne!(nearest_center(&centers, &[0.0]), nearest_center(&centers, &[5.0]));
/// ```
pub fn cluster_centers(points: &[f32], width: usize, k: usize, seed: u64) -> Vec<f32> {
    let tries = (0..TRIES).map(|i| lloyd(points, width, spread(points, width, k, Stream::new(seed, i, "vad.kmeans"))));
    let cost = |centers: &Vec<f32>| points.chunks_exact(width).map(|p| nearest(centers, p).1).sum::<f64>();
    let mut best: Option<(f64, Vec<f32>)> = None;
    for centers in tries {
        let cost = cost(&centers);
        if best.as_ref().is_none_or(|(least, _)| cost < *least) {
            best = Some((cost, centers));
        }
    }
    best.map(|(_, centers)| centers).unwrap_or_default()
}

/// Index of the nearest of the centers `[k, width]` to a point, the first of equally near ones.
pub fn nearest_center(centers: &[f32], point: &[f32]) -> usize {
    nearest(centers, point).0
}

fn nearest(centers: &[f32], point: &[f32]) -> (usize, f64) {
    let distance = |c: &[f32]| c.iter().zip(point).map(|(a, b)| f64::from(a - b).powi(2)).sum::<f64>();
    let all = centers.chunks_exact(point.len()).map(distance).enumerate();
    all.fold((0, f64::INFINITY), |best, (i, d)| if d < best.1 { (i, d) } else { best })
}

/// Points far from each other.
fn spread(points: &[f32], width: usize, k: usize, stream: Stream) -> Vec<f32> {
    let count = points.len() / width;
    if count == 0 {
        return Vec::new();
    }
    let mut centers = points[stream.below(0, count) * width..][..width].to_vec();
    for draw in 1..k {
        let far: Vec<f64> = points.chunks_exact(width).map(|p| nearest(&centers, p).1).collect();
        let mut left = stream.uniform::<f64>(draw as u64) * far.iter().sum::<f64>();
        let Some(last) = far.iter().rposition(|d| *d > 0.0) else { break };
        let chosen = far.iter().position(|d| {
            left -= d;
            left < 0.0
        });
        centers.extend_from_slice(&points[chosen.unwrap_or(last) * width..][..width]);
    }
    centers
}

fn lloyd(points: &[f32], width: usize, mut centers: Vec<f32>) -> Vec<f32> {
    let mut of: Vec<usize> = Vec::new();
    for _ in 0..ROUNDS {
        let now: Vec<usize> = points.chunks_exact(width).map(|p| nearest_center(&centers, p)).collect();
        if now == of {
            break;
        }
        of = now;
        for (c, center) in centers.chunks_exact_mut(width).enumerate() {
            let members: Vec<&[f32]> =
                points.chunks_exact(width).zip(&of).filter(|(_, of)| **of == c).map(|(p, _)| p).collect();
            // A cluster without points keeps its center.
            if !members.is_empty() {
                let mean = |d: usize| members.iter().map(|p| f64::from(p[d])).sum::<f64>() / members.len() as f64;
                center.iter_mut().enumerate().for_each(|(d, x)| *x = mean(d) as f32);
            }
        }
    }
    centers
}
