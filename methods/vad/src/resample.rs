//! Resampling of videos of any length to a fixed number of segments.

/// Means of the features of `segments` equal parts of a video: with `r = floor(linspace(0, S, T + 1))`, segment j is
/// the mean of rows `r_j..r_{j+1}`, or row `r_j` if this range is empty.
///
/// `features` is `[S, width]`, S > 0; the result `[segments, width]`. Sultani et al., arXiv 1801.04264, section 4.1.
///
/// # Panics
/// When there is no row.
///
/// ```
/// assert_eq!(weaver_vad::resample(&[1.0, 3.0, 5.0], 1, 2), [1.0, 4.0]);
/// assert_eq!(weaver_vad::resample(&[7.0], 1, 3), [7.0; 3]);
/// ```
pub fn resample(features: &[f32], width: usize, segments: usize) -> Vec<f32> {
    let rows = features.len() / width;
    assert!(rows > 0, "a video has at least one snippet");
    let mut out = vec![0.0; segments * width];
    // As NumPy rounds: a product of a step, and the end exactly.
    let step = rows as f64 / segments as f64;
    let bound = |j: usize| if j == segments { rows } else { (j as f64 * step) as usize };
    for (j, out) in out.chunks_exact_mut(width).enumerate() {
        let start = bound(j);
        let end = bound(j + 1).max(start + 1);
        // Sums in f64, so that segments of thousands of snippets lose nothing.
        for (d, out) in out.iter_mut().enumerate() {
            let sum: f64 = (start..end).map(|row| f64::from(features[row * width + d])).sum();
            *out = (sum / (end - start) as f64) as f32;
        }
    }
    out
}
