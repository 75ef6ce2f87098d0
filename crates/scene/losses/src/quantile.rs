//! Quantiles with linear interpolation, of slices.

use std::cmp::Ordering;
use weaver_kernels::Real;

pub(crate) fn order<T: Real>(a: T, b: T) -> Ordering {
    a.to_f64().total_cmp(&b.to_f64())
}

/// The items just below and above the position q (n - 1) of the sorted sequence, and how far it is from the first to
/// the second.
pub(crate) fn neighbors<U: Copy>(items: &mut [U], q: f64, compare: impl Fn(&U, &U) -> Ordering) -> (U, U, f64) {
    assert!(!items.is_empty() && (0.0..=1.0).contains(&q), "the {q}-quantile of {} numbers", items.len());
    let position = q * (items.len() - 1) as f64;
    let below = position.floor();
    let (_, lower, above) = items.select_nth_unstable_by(below as usize, &compare);
    let lower = *lower;
    (lower, above.iter().copied().min_by(compare).unwrap_or(lower), position - below)
}

pub(crate) fn between<T: Real>(lower: T, upper: T, fraction: f64) -> T {
    // An infinite neighbor that has no weight stays out of it.
    if fraction == 0.0 { lower } else { lower + (upper - lower) * T::from_f64(fraction) }
}

/// The `q`-quantile of n numbers, with 0 <= q <= 1.
///
/// It lies at position q (n - 1) of the sorted sequence, interpolated linearly between the two neighbors. Reorders the
/// numbers and takes linear time. Panics when there are none.
///
/// ```
/// assert_eq!(weaver_losses::quantile(&mut [4.0, 1.0, 3.0, 2.0], 0.5), 2.5);
/// ```
pub fn quantile<T: Real>(values: &mut [T], q: f64) -> T {
    let (lower, upper, fraction) = neighbors(values, q, |a, b| order(*a, *b));
    between(lower, upper, fraction)
}
