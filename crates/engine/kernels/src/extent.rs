//! Sizes of arrays, computed without overflow for the checks of slice lengths.

/// The product of the counts; `None` if it overflows.
pub fn product<const N: usize>(counts: [usize; N]) -> Option<usize> {
    if counts.contains(&0) {
        return Some(0);
    }
    counts.into_iter().try_fold(1, usize::checked_mul)
}

/// The length of the shortest slice that holds a strided array, given `(count, stride)` of each dimension; `None` if it
/// overflows.
pub fn extent<const N: usize>(dims: [(usize, usize); N]) -> Option<usize> {
    if dims.iter().any(|(count, _)| *count == 0) {
        return Some(0);
    }
    dims.into_iter().try_fold(1, |reach: usize, (count, stride)| reach.checked_add((count - 1).checked_mul(stride)?))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nothing_wraps_around() {
        const MOST: usize = usize::MAX;
        assert_eq!((product([2, 3, 4]), product([MOST, 2, 0]), product([MOST, 2])), (Some(24), Some(0), None));
        assert_eq!((extent([(2, 10), (3, 1)]), extent([(0, MOST), (3, 1)])), (Some(13), Some(0)));
        assert_eq!((extent([(2, MOST)]), extent([(3, MOST / 2 + 1)])), (None, None));
    }
}
