//! Numbers as entries of a table of 256.

/// Entries of a table.
pub(super) const ENTRIES: usize = 256;
/// Rounds of improvement.
const ROUNDS: usize = 30;

/// A table of increasing numbers.
pub(super) struct Codebook {
    pub numbers: Vec<f32>,
}

impl Codebook {
    /// The table with the least sum of squared distances that Lloyd's method finds for `values`, which are finite;
    /// where there are no more than 256 different ones, it is exact.
    ///
    /// Half of the entries start at quantiles, the others evenly spaced, so that rare extremes are not left without
    /// any.
    pub(super) fn of(mut values: Vec<f32>) -> Self {
        values.sort_unstable_by(f32::total_cmp);
        let mut different = values.clone();
        different.dedup();
        if different.len() <= ENTRIES {
            different.resize(ENTRIES, different.last().copied().unwrap_or(0.0));
            return Self { numbers: different };
        }
        let sums: Vec<f64> = std::iter::once(0.0)
            .chain(values.iter().scan(0.0, |sum, x| {
                *sum += f64::from(*x);
                Some(*sum)
            }))
            .collect();
        let (least, most) = (values[0], values[values.len() - 1]);
        let half = ENTRIES / 2;
        let share = |i: usize| i as f32 / (half - 1) as f32;
        let quantile = |i: usize| values[(values.len() - 1) * i / (half - 1)];
        let mut numbers: Vec<f32> =
            (0..half).flat_map(|i| [quantile(i), least * (1.0 - share(i)) + most * share(i)]).collect();
        for _ in 0..ROUNDS {
            numbers.sort_unstable_by(f32::total_cmp);
            let mut start = 0;
            for i in 0..ENTRIES {
                let end = match numbers.get(i + 1) {
                    Some(next) => {
                        let border = 0.5 * (numbers[i] + next);
                        start + values[start..].partition_point(|x| *x <= border)
                    }
                    None => values.len(),
                };
                if end > start {
                    numbers[i] = ((sums[end] - sums[start]) / (end - start) as f64) as f32;
                }
                start = end;
            }
        }
        numbers.sort_unstable_by(f32::total_cmp);
        Self { numbers }
    }

    /// The nearest entry.
    pub(super) fn index(&self, value: f32) -> u8 {
        let next = self.numbers.partition_point(|x| *x < value).min(ENTRIES - 1);
        let before = next.saturating_sub(1);
        let nearer = (value - self.numbers[before]).abs() <= (self.numbers[next] - value).abs();
        (if nearer { before } else { next }) as u8
    }
}
