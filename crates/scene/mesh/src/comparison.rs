//! How far a surface is from another.

use weaver_kernels::nearest_neighbors::nearest_among;

/// Distances beyond this are no errors of accuracy, but something that is missing, meters.
const FAR: f64 = 0.5;

/// Errors of a surface, as clouds of points.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct MeshErrors {
    /// Mean distance of its points to the reference, of those nearer than 0.5 m, meters.
    pub accuracy: f64,
    /// Mean distance of the reference's points to it, each at most 0.5 m, meters.
    pub completeness: f64,
    /// Mean of the two.
    pub chamfer: f64,
    /// Share of its points within the threshold of the reference.
    pub precision: f64,
    /// Share of the reference's points within the threshold of it.
    pub recall: f64,
    /// Harmonic mean of precision and recall.
    pub f_score: f64,
}

/// Compares the points of a surface with those of a reference; `near` is the threshold of the F-score, meters.
///
/// ```
/// let plane = |z: f32| (0..100).map(|i| [i as f32 % 10.0, (i / 10) as f32, z]).collect::<Vec<_>>();
/// let errors = weaver_mesh::compare(&plane(0.1), &plane(0.0), 0.2);
/// assert!((errors.chamfer - 0.1).abs() < 1e-6 && errors.f_score == 1.0);
/// ```
pub fn compare(points: &[[f32; 3]], reference: &[[f32; 3]], near: f64) -> MeshErrors {
    if points.is_empty() || reference.is_empty() {
        return MeshErrors { completeness: FAR, ..MeshErrors::default() };
    }
    let share = |d: &[f64]| d.iter().filter(|d| **d < near).count() as f64 / d.len() as f64;
    let (own, others) = (distances(points, reference), distances(reference, points));
    let within: Vec<f64> = own.iter().copied().filter(|d| *d < FAR).collect();
    let accuracy = within.iter().sum::<f64>() / within.len().max(1) as f64;
    let completeness = others.iter().map(|d| d.min(FAR)).sum::<f64>() / others.len() as f64;
    let (precision, recall) = (share(&own), share(&others));
    let f_score = if precision + recall > 0.0 { 2.0 * precision * recall / (precision + recall) } else { 0.0 };
    MeshErrors { accuracy, completeness, chamfer: (accuracy + completeness) / 2.0, precision, recall, f_score }
}

/// Distances of points to the nearest of others; none where there are no others.
pub(crate) fn distances(of: &[[f32; 3]], to: &[[f32; 3]]) -> Vec<f64> {
    if to.is_empty() {
        return Vec::new();
    }
    let mut squares = vec![0.0_f32; of.len()];
    nearest_among(to.as_flattened(), of.as_flattened(), &mut squares);
    squares.into_iter().map(|square| f64::from(square).sqrt()).collect()
}

/// One point of each cube of a side, the first.
pub fn thinned(points: &[[f32; 3]], side: f64) -> Vec<[f32; 3]> {
    let cube = |p: &[f32; 3]| p.map(|x| (f64::from(x) / side).floor() as i64);
    let mut keyed: Vec<([i64; 3], usize)> = points.iter().enumerate().map(|(i, p)| (cube(p), i)).collect();
    keyed.sort_unstable();
    keyed.dedup_by_key(|(cube, _)| *cube);
    let mut kept: Vec<usize> = keyed.into_iter().map(|(_, i)| i).collect();
    kept.sort_unstable();
    kept.into_iter().map(|i| points[i]).collect()
}
