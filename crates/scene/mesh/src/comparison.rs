//! Distances between surfaces.

use weaver_kernels::nearest_neighbors::nearest_among;

/// Distance from which on a point of a surface is no error of accuracy, but one that should not be there, meters.
pub const FAR: f64 = 0.5;

/// Errors of a surface, as clouds of points.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MeshErrors {
    /// Mean distance of its points to the reference, of those nearer than [`FAR`], meters; none where no point is.
    pub accuracy: Option<f64>,
    /// Mean distance of the reference's points to it, each at most [`FAR`], meters.
    pub completeness: f64,
    /// Mean of the two, if there are both.
    pub chamfer: Option<f64>,
    /// Share of its points that are farther from the reference than [`FAR`], which accuracy leaves out.
    pub beyond: f64,
    /// Share of its points within the threshold of the reference.
    pub precision: f64,
    /// Share of the reference's points within the threshold of it.
    pub recall: f64,
    /// Harmonic mean of precision and recall.
    pub f_score: f64,
}

/// Compares the points of a surface with a reference's; `near` is the threshold of the F-score, meters. `None` where
/// one has no points.
///
/// ```
/// let plane = |z: f32| (0..100).map(|i| [i as f32 % 10.0, (i / 10) as f32, z]).collect::<Vec<_>>();
/// let errors = weaver_mesh::compare(&plane(0.1), &plane(0.0), 0.2).unwrap();
/// assert!((errors.chamfer.unwrap() - 0.1).abs() < 1e-6 && errors.f_score == 1.0);
/// assert_eq!(weaver_mesh::compare(&[], &plane(0.0), 0.2), None);
/// ```
pub fn compare(points: &[[f32; 3]], reference: &[[f32; 3]], near: f64) -> Option<MeshErrors> {
    let (own, others) = (distances(points, reference), distances(reference, points));
    let within = mean(own.iter().copied().filter(|d| *d < FAR));
    let completeness = mean(others.iter().map(|d| d.min(FAR)))?;
    let share = |d: &[f64], reach: f64| d.iter().filter(|d| **d < reach).count() as f64 / d.len() as f64;
    let (precision, recall) = (share(&own, near), share(&others, near));
    let f_score = if precision + recall > 0.0 { 2.0 * precision * recall / (precision + recall) } else { 0.0 };
    let chamfer = within.map(|accuracy| (accuracy + completeness) / 2.0);
    Some(MeshErrors {
        accuracy: within,
        completeness,
        chamfer,
        beyond: 1.0 - share(&own, FAR),
        precision,
        recall,
        f_score,
    })
}

/// The mean of numbers, if there are any.
pub(crate) fn mean(values: impl Iterator<Item = f64>) -> Option<f64> {
    let (sum, count) = values.fold((0.0, 0_usize), |(sum, count), x| (sum + x, count + 1));
    (count > 0).then(|| sum / count as f64)
}

/// Distances of points to the nearest of `others`; none if there are no others.
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
