//! Order statistics: values by their place in ascending order.
//!
//! The order is total (IEEE 754 `totalOrder`): -0 stands before 0, and NaN at the ends, so that a result never depends
//! on the order of the arguments.

use crate::Real;
use std::cmp::Ordering;

/// The total order of two numbers, for sorting.
pub fn ascending<T: Real>(a: &T, b: &T) -> Ordering {
    a.to_f64().total_cmp(&b.to_f64())
}

/// The value x_(k) with k = `rank`, from 0, of the ascending sequence; `None` from its end on. Reorders the values;
/// linear time.
///
/// ```
/// use weaver_kernels::order::nth;
/// assert_eq!(nth(&mut [4.0, 1.0, 3.0, 2.0], 1), Some(2.0));
/// assert_eq!(nth(&mut [4.0, 1.0], 2), None);
/// ```
pub fn nth<T: Real>(values: &mut [T], rank: usize) -> Option<T> {
    (rank < values.len()).then(|| *values.select_nth_unstable_by(rank, ascending).1)
}

/// The upper median x_(floor(n / 2)): of an even count the larger of the two values in the middle; `None` of no values.
///
/// ```
/// use weaver_kernels::order::{median_high, median_mean};
/// let values = [4.0, 1.0, 3.0, 2.0];
/// assert_eq!((median_high(&mut values.clone()), median_mean(&mut values.clone())), (Some(3.0), Some(2.5)));
/// ```
pub fn median_high<T: Real>(values: &mut [T]) -> Option<T> {
    nth(values, values.len() / 2)
}

/// The median (x_(floor((n - 1) / 2)) + x_(floor(n / 2))) / 2: of an even count the mean of the two values in the
/// middle; `None` of no values.
pub fn median_mean<T: Real>(values: &mut [T]) -> Option<T> {
    if values.is_empty() {
        return None;
    }
    let middle = values.len() / 2;
    let (below, upper, _) = values.select_nth_unstable_by(middle, ascending);
    let upper = *upper;
    let lower = below.iter().copied().max_by(ascending).filter(|_| values.len().is_multiple_of(2));
    Some(lower.map_or(upper, |lower| (lower + upper) / T::from_f64(2.0)))
}

/// The `q`-quantile x_(k) + f (x_(k + 1) - x_(k)) with k + f = q (n - 1) and integer k.
///
/// Reorders the values and takes linear time. Panics when there are none, and unless 0 <= q <= 1.
///
/// ```
/// assert_eq!(weaver_kernels::order::quantile(&mut [4.0, 1.0, 3.0, 2.0], 0.5), 2.5);
/// ```
pub fn quantile<T: Real>(values: &mut [T], q: f64) -> T {
    let neighbors = QuantileNeighbors::of(values, q, ascending);
    neighbors.between(neighbors.lower, neighbors.upper)
}

/// The two neighbors of a quantile, in any order.
#[derive(Clone, Copy, Debug, Default)]
pub struct QuantileNeighbors<U> {
    /// The item just below the position q (n - 1), or at it.
    pub lower: U,
    /// The next item; the same one at the end.
    pub upper: U,
    /// The distance of the position from the lower item's, in [0, 1).
    pub fraction: f64,
}

impl<U: Copy> QuantileNeighbors<U> {
    /// Finds them among `items`, which are reordered. Panics when there are none, and unless 0 <= q <= 1.
    pub fn of(items: &mut [U], q: f64, compare: impl Fn(&U, &U) -> Ordering) -> Self {
        assert!(!items.is_empty() && (0.0..=1.0).contains(&q), "the {q}-quantile of {} numbers", items.len());
        let position = q * (items.len() - 1) as f64;
        let below = position.floor();
        let (_, lower, above) = items.select_nth_unstable_by(below as usize, &compare);
        let lower = *lower;
        let upper = above.iter().copied().min_by(compare).unwrap_or(lower);
        Self { lower, upper, fraction: position - below }
    }

    /// The quantile from the values of both items.
    pub fn between<T: Real>(&self, lower: T, upper: T) -> T {
        // An infinite neighbor that has no weight stays out of it.
        if self.fraction == 0.0 { lower } else { lower + (upper - lower) * T::from_f64(self.fraction) }
    }
}
