//! Positions of tokens in their view, as rotary embeddings of attention.

use std::sync::Arc;
use weaver_autograd::ops::RopeTable;
use weaver_autograd::{Real, Tape};

/// Base of the frequencies.
const BASE: f64 = 100.0;

/// The tokens of some views: in each, registers at (0, 0), then patches at (column + 1, row + 1), row by row.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Positions {
    /// Registers of each view.
    pub registers: usize,
    /// Rows and columns of patches.
    pub grid: [usize; 2],
    /// Number of views.
    pub views: usize,
}

impl Positions {
    /// Column and row of each token; the column turns the first half of a vector.
    fn list(&self) -> Vec<[usize; 2]> {
        let [rows, columns] = self.grid;
        let patches = (0..rows * columns).map(|i| [i % columns + 1, i / columns + 1]);
        std::iter::repeat_n([0, 0], self.registers).chain(patches).collect::<Vec<_>>().repeat(self.views)
    }

    /// The angles of all tokens for vectors of `width` numbers, made once per tape.
    pub fn turns<T: Real>(self, tape: &Tape<T>, width: usize) -> Arc<RopeTable<T>> {
        tape.pool().table((self, width), || RopeTable::new(&self.list(), width, BASE))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn registers_are_at_the_origin_and_columns_come_first() {
        let view = [[0, 0], [1, 1], [2, 1], [1, 2], [2, 2]];
        assert_eq!(Positions { registers: 1, grid: [2, 2], views: 2 }.list(), [view, view].concat());
    }
}
