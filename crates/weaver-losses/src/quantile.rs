//! Quantiles with linear interpolation.

use weaver_autograd::Real;

/// The `q`-quantile of some numbers, 0 <= q <= 1: at position q (n - 1) of the sorted sequence, interpolated linearly
/// between the two neighbours. Reorders the numbers; takes linear time. Panics when there are none.
///
/// ```
/// assert_eq!(weaver_losses::quantile(&mut [4.0, 1.0, 3.0, 2.0], 0.5), 2.5);
/// ```
pub fn quantile<T: Real>(values: &mut [T], q: f64) -> T {
    assert!(!values.is_empty() && (0.0..=1.0).contains(&q), "the {q}-quantile of {} numbers", values.len());
    let position = q * (values.len() - 1) as f64;
    let below = position.floor();
    let (_, lower, above) = values.select_nth_unstable_by(below as usize, |a, b| a.to_f64().total_cmp(&b.to_f64()));
    let lower = *lower;
    let Some(upper) = above.iter().copied().reduce(Real::min) else { return lower };
    lower + (upper - lower) * T::from_f64(position - below)
}
