//! Real roots of polynomials of a small degree.

/// Steps of a bracketed search; bisection alone would end near the last bits.
const STEPS: usize = 200;

/// The value of a polynomial whose coefficients ascend.
pub(super) fn value(of: &[f64], x: f64) -> f64 {
    of.iter().rev().fold(0.0, |sum, c| sum * x + c)
}

/// The real roots of odd multiplicity of a polynomial whose coefficients ascend, ascending.
///
/// Between two neighboring extrema a polynomial has one root or none, and its extrema are the roots of its derivative.
pub(super) fn roots(of: &[f64]) -> Vec<f64> {
    let largest = of.iter().fold(0.0, |most: f64, c| most.max(c.abs()));
    let negligible = |c: &f64| c.abs() <= 1e-14 * largest;
    let of = &of[..of.len() - of.iter().rev().take_while(|c| negligible(c)).count()];
    let Some((leading, rest)) = of.split_last() else { return Vec::new() };
    // Fujiwara's bound.
    let degree = rest.len();
    let each = rest.iter().enumerate().map(|(power, c)| (c / leading).abs().powf(1.0 / (degree - power) as f64));
    let bound = 2.0 * each.fold(f64::MIN_POSITIVE, f64::max);
    if !bound.is_finite() {
        return Vec::new();
    }
    // From the derivative with one root left up to the polynomial itself.
    let mut found = Vec::new();
    for order in (0..degree).rev() {
        let derivative: Vec<f64> = (order..of.len())
            .map(|power| of[power] * (power + 1 - order..=power).map(|k| k as f64).product::<f64>())
            .collect();
        let ends: Vec<f64> = std::iter::once(-bound).chain(found).chain([bound]).collect();
        found = ends.windows(2).filter_map(|ends| between(&derivative, ends[0], ends[1])).collect();
    }
    found
}

/// The root between two places, if values there have different signs: Newton's steps where they stay inside.
fn between(of: &[f64], mut low: f64, mut high: f64) -> Option<f64> {
    let (at_low, at_high) = (value(of, low), value(of, high));
    if at_low == 0.0 {
        return Some(low);
    }
    if (at_low > 0.0) == (at_high > 0.0) || at_high == 0.0 {
        return None;
    }
    let mut x = 0.5 * (low + high);
    for _ in 0..STEPS {
        let (mut y, mut slope) = (0.0, 0.0);
        for c in of.iter().rev() {
            slope = slope * x + y;
            y = y * x + c;
        }
        if y == 0.0 {
            return Some(x);
        }
        if (y > 0.0) == (at_low > 0.0) {
            low = x;
        } else {
            high = x;
        }
        let newton = x - y / slope;
        let next = if newton >= low && newton <= high { newton } else { 0.5 * (low + high) };
        if (next - x).abs() <= 1e-15 * x.abs().max(1e-300) {
            return Some(next);
        }
        x = next;
    }
    Some(x)
}

#[cfg(test)]
mod tests {
    use super::*;
    use weaver_kernels::random::Stream;

    #[test]
    fn roots_are_where_they_were_put() {
        for seed in 0..200 {
            let stream = Stream::new(seed, 0, "test.polynomial");
            let count = 1 + stream.below(0, 6);
            let mut planted: Vec<f64> = (0..count).map(|k| 3.0 * stream.normal::<f64>(1 + k as u64)).collect();
            // And two that are complex.
            let mut of = vec![1.0 + stream.uniform::<f64>(20), 0.5, 1.0];
            for root in &planted {
                let mut next = vec![0.0; of.len() + 1];
                of.iter().enumerate().for_each(|(power, c)| {
                    next[power + 1] += c;
                    next[power] -= c * root;
                });
                of = next;
            }
            planted.sort_by(f64::total_cmp);
            let found = roots(&of);
            assert_eq!(found.len(), planted.len(), "{planted:?} {found:?}");
            for (a, b) in found.iter().zip(&planted) {
                assert!((a - b).abs() < 1e-4 * (1.0 + b.abs()), "{a} and {b}");
            }
        }
    }

    #[test]
    fn what_has_no_root_has_none() {
        for of in [&[][..], &[0.0], &[3.0], &[1.0, 0.0, 1.0], &[0.0, 0.0, 0.0], &[f64::NAN, 1.0]] {
            assert!(roots(of).is_empty(), "{of:?}");
        }
        assert_eq!(roots(&[-1.0, 2.0, 0.0]), [0.5]);
    }
}
