//! Greedy division, against one that looks through all cells each time.

use proptest::prelude::*;
use weaver_kernels::random::Stream;
use weaver_kernels::subdivision::subdivide;

/// A range of numbers.
type Range = std::ops::Range<usize>;

/// Up to three parts; none of a short range.
fn parts(range: &Range, most: usize) -> Vec<Range> {
    let of = most.min(range.len());
    let cut = |i: usize| range.start + range.len() * i / of;
    if of < 2 { Vec::new() } else { (0..of).map(|i| cut(i)..cut(i + 1)).collect() }
}

/// The same, slowly.
fn slow(mut cells: Vec<Range>, count: usize, most: usize, error: impl Fn(&Range) -> u64) -> Vec<Range> {
    while cells.len() + most - 1 <= count {
        let mut worst: Option<usize> = None;
        for (place, cell) in cells.iter().enumerate().filter(|(_, cell)| !parts(cell, most).is_empty()) {
            if worst.is_none_or(|worst| error(cell) > error(&cells[worst])) {
                worst = Some(place);
            }
        }
        let Some(worst) = worst else { break };
        let mut parts = parts(&cells[worst], most);
        cells.extend(parts.drain(1..));
        cells[worst] = parts.remove(0);
    }
    cells
}

proptest! {
    #[test]
    fn the_worst_cell_is_divided_first(seed: u64, length in 1_usize..60, count in 0_usize..80, most in 2_usize..4) {
        let stream = Stream::new(seed, 0, "subdivision");
        // Few values, so that many are equal.
        let errors: Vec<u64> = (0..length as u64).map(|i| (4.0 * stream.uniform::<f64>(i)) as u64).collect();
        let error = |range: &Range| errors[range.clone()].iter().sum::<u64>();
        let roots = parts(&(0..length), 3.min(length)).into_iter().collect::<Vec<_>>();
        let found = subdivide(roots.clone(), count, most, error, |range| parts(range, most));
        prop_assert!(found.len() <= count.max(roots.len()));
        prop_assert_eq!(found, slow(roots, count, most, error));
    }
}
