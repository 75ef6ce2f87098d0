//! Blocks of cells, sorted by where they are.

/// Cells per side of a block.
pub(crate) const SIDE: i32 = 8;
/// Cells of a block.
pub(crate) const CELLS: usize = 512;

/// Column, row and layer of a block or a cell.
pub(crate) type Place = [i32; 3];

/// The block of a cell, and the cell's place in it.
pub(crate) fn split(cell: Place) -> (Place, usize) {
    let block = cell.map(|x| x.div_euclid(SIDE));
    let [x, y, z] = cell.map(|x| x.rem_euclid(SIDE) as usize);
    (block, (z * 8 + y) * 8 + x)
}

/// The cell at a place of a block.
pub(crate) fn cell(block: Place, at: usize) -> Place {
    let within = [at % 8, at / 8 % 8, at / 64];
    std::array::from_fn(|axis| block[axis] * SIDE + within[axis] as i32)
}

/// Neighboring blocks beyond the faces, edges and corners of one, for fast lookup of cells around it.
pub(crate) struct Around {
    center: Place,
    /// Index of each of the 27 blocks.
    index: [Option<usize>; 27],
}

impl Around {
    pub fn new(blocks: &[Place], center: Place) -> Self {
        let index = std::array::from_fn(|i| {
            let offset = [i % 3, i / 3 % 3, i / 9].map(|x| x as i32 - 1);
            let place: Place = std::array::from_fn(|axis| center[axis] + offset[axis]);
            blocks.binary_search(&place).ok()
        });
        Self { center, index }
    }

    /// The index of a cell's block and its place in it; none where there is no such block.
    pub fn find(&self, cell: Place) -> Option<(usize, usize)> {
        let (block, at) = split(cell);
        let offset: [i32; 3] = std::array::from_fn(|axis| block[axis] - self.center[axis] + 1);
        let known = offset.iter().all(|x| (0..3).contains(x));
        let index = known.then(|| self.index[(offset[2] * 9 + offset[1] * 3 + offset[0]) as usize])?;
        index.map(|index| (index, at))
    }
}
