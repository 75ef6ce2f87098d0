//! Greedy division of cells: the cell described worst is divided first, until there are enough.

use std::cmp::Reverse;
use std::collections::BinaryHeap;

/// Divides cells until there are `count`, or until no further division fits or is possible: always the cell of highest
/// priority, and the earliest among equals. Returns them all.
///
/// A cell becomes at most `most` parts, by `parts`; one without any stays as it is. The first part takes the place of
/// the cell, the others come last.
///
/// Where priorities are errors that no division raises, every cell that was divided had an error at least as large as
/// any that is left.
///
/// ```
/// use weaver_kernels::subdivision::subdivide;
/// // Whole numbers, halved from the largest down.
/// let halves = |n: &u32| [n / 2, n - n / 2].into_iter().filter(|_| *n > 1).collect::<Vec<_>>();
/// assert_eq!(subdivide(vec![9, 3], 5, 2, |n| *n, halves), [2, 3, 2, 3, 2]);
/// ```
pub fn subdivide<C, P: Ord, I: IntoIterator<Item = C>>(
    roots: Vec<C>,
    count: usize,
    most: usize,
    priority: impl Fn(&C) -> P,
    mut parts: impl FnMut(&C) -> I,
) -> Vec<C> {
    let rank = |cell: &C, place: usize| (priority(cell), Reverse(place));
    let mut cells = roots;
    let mut open: BinaryHeap<_> = cells.iter().enumerate().map(|(place, cell)| rank(cell, place)).collect();
    while cells.len() + most <= count + 1 {
        let Some((_, Reverse(place))) = open.pop() else { break };
        let mut parts = parts(&cells[place]).into_iter();
        let Some(first) = parts.next() else { continue };
        open.push(rank(&first, place));
        cells[place] = first;
        for part in parts {
            open.push(rank(&part, cells.len()));
            cells.push(part);
        }
    }
    cells
}
