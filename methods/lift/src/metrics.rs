//! Agreement of labels with the truth.

use std::collections::BTreeMap;
use weaver_kernels::Real;

/// The part of `predicted` that equals `truth`; 1 for empty lists.
///
/// # Panics
/// If the lengths differ.
pub fn accuracy(predicted: &[u32], truth: &[u32]) -> f64 {
    assert_eq!(predicted.len(), truth.len(), "accuracy: lengths");
    let right = predicted.iter().zip(truth).filter(|(a, b)| a == b).count();
    if truth.is_empty() { 1.0 } else { right as f64 / truth.len() as f64 }
}

/// Intersection over union, averaged over the classes of `truth` with at least `least` pixels; `None` without such a
/// class.
///
/// # Panics
/// If the lengths differ.
///
/// ```
/// use weaver_lift::metrics::mean_iou;
/// // Class 0: two pixels of four in either; class 1: two of three.
/// assert_eq!(mean_iou(&[0, 0, 0, 1, 1], &[0, 0, 1, 1, 1], 1), Some((2.0 / 3.0 + 2.0 / 3.0) / 2.0));
/// ```
pub fn mean_iou(predicted: &[u32], truth: &[u32], least: usize) -> Option<f64> {
    assert_eq!(predicted.len(), truth.len(), "mean_iou: lengths");
    // Pixels in both, in the prediction, in the truth.
    let mut classes: BTreeMap<u32, [usize; 3]> = BTreeMap::new();
    for (a, b) in predicted.iter().zip(truth) {
        classes.entry(*a).or_default()[1] += 1;
        let of_truth = classes.entry(*b).or_default();
        of_truth[2] += 1;
        of_truth[0] += usize::from(a == b);
    }
    let counted = classes.values().filter(|[_, _, truth]| *truth >= least.max(1));
    let ious: Vec<f64> = counted.map(|[both, a, b]| *both as f64 / (a + b - both) as f64).collect();
    (!ious.is_empty()).then(|| ious.iter().sum::<f64>() / ious.len() as f64)
}

/// The cosine of the angle between two vectors; 0 if one is zero.
pub fn cosine<T: Real>(a: &[T], b: &[T]) -> f64 {
    let dot = |a: &[T], b: &[T]| a.iter().zip(b).map(|(a, b)| a.to_f64() * b.to_f64()).sum::<f64>();
    let lengths = (dot(a, a) * dot(b, b)).sqrt();
    if lengths > 0.0 { dot(a, b) / lengths } else { 0.0 }
}

/// The index of the largest of each row's `channels` values, the first of equal ones.
///
/// ```
/// assert_eq!(weaver_lift::metrics::argmax(&[0.1, 0.3, 0.5, 0.5], 2), [1, 0]);
/// ```
pub fn argmax<T: Real>(values: &[T], channels: usize) -> Vec<u32> {
    let largest = |row: &[T]| (1..row.len()).fold(0, |best, i| if row[i] > row[best] { i } else { best }) as u32;
    values.chunks_exact(channels.max(1)).map(largest).collect()
}
