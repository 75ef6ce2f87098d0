//! All cells of a scene, as quadtrees: each coarsest cell of each view is the root of one.

use crate::cell::{COARSEST, Cell};

/// The quadtrees of the views of a scene.
#[derive(Clone, Debug)]
pub(super) struct Forest {
    levels: Vec<Level>,
}

/// The cells of one level, in (view, row, column) order.
#[derive(Clone, Copy, Debug)]
struct Level {
    /// Number of the first one among the nodes of all levels.
    first: usize,
    views: usize,
    rows: usize,
    columns: usize,
}

impl Forest {
    pub fn new(views: usize, height: usize, width: usize) -> Self {
        let mut first = 0;
        let level = |level: u8| {
            let [rows, columns] = [height, width].map(|length| length.div_ceil(1 << level));
            let level = Level { first, views, rows, columns };
            first += views * rows * columns;
            level
        };
        Self { levels: (0..=COARSEST).map(level).collect() }
    }

    /// Number of nodes of all levels.
    pub fn nodes(&self) -> usize {
        self.level(COARSEST).end
    }

    /// The nodes of a level.
    pub fn level(&self, level: u8) -> std::ops::Range<usize> {
        let Level { first, views, rows, columns } = self.levels[usize::from(level)];
        first..first + views * rows * columns
    }

    /// The level of a node.
    pub fn level_of(&self, node: usize) -> u8 {
        (self.levels.partition_point(|level| level.first <= node) - 1) as u8
    }

    /// View and cell of a node.
    pub fn cell(&self, node: usize) -> (usize, Cell) {
        let level = self.level_of(node);
        let Level { first, rows, columns, .. } = self.levels[usize::from(level)];
        let at = node - first;
        let (view, row, column) = (at / (rows * columns), at / columns % rows, at % columns);
        (view, Cell { row: row << level, column: column << level, level })
    }

    /// The nodes into which a node of this level is divided: up to four.
    pub fn children(&self, level: u8, node: usize) -> impl Iterator<Item = usize> + use<> {
        let own = self.levels[usize::from(level)];
        let below = self.levels[usize::from(level) - 1];
        let at = node - own.first;
        let (view, row, column) = (at / (own.rows * own.columns), at / own.columns % own.rows, at % own.columns);
        let rows = 2 * row..(2 * row + 2).min(below.rows);
        rows.flat_map(move |r| {
            (2 * column..(2 * column + 2).min(below.columns))
                .map(move |c| below.first + (view * below.rows + r) * below.columns + c)
        })
    }
}
