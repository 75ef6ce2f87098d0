//! Sums over observations.

/// Numbers of a block, and as many as fill a vector.
pub(super) const BLOCK: usize = 6;
pub(super) const PADDED: usize = 8;
/// Numbers of a row of an observation: its camera's, its lens's if the lens is adjusted, and the difference; padded to
/// fours.
pub(super) const WIDE: usize = 12;
pub(super) const NARROW: usize = 8;
/// Numbers that the compiler keeps in a register.
pub(super) const FOUR: usize = 4;

/// Coupling of a block with a point, one row for each coordinate of the point.
#[derive(Clone, Copy, Debug, Default)]
#[repr(C, align(64))]
pub(super) struct Coupling(pub [[f64; PADDED]; 3]);

/// Sum of the outer products of the rows of a camera, in columns of four; of the columns above the diagonal only those
/// beside it.
#[derive(Clone, Copy, Debug, Default)]
#[repr(C, align(64))]
pub(super) struct Sums(pub [[[f64; FOUR]; WIDE]; WIDE / FOUR]);

impl Sums {
    pub fn add(&mut self, other: &Self) {
        let both = self.0.as_flattened_mut().as_flattened_mut().iter_mut().zip(other.0.as_flattened().as_flattened());
        both.for_each(|(x, y)| *x += y);
    }

    /// The element of a row and a column of the symmetric matrix.
    pub fn at(&self, row: usize, column: usize) -> f64 {
        let (row, column) = (row.max(column), row.min(column));
        self.0[column / FOUR][row][column % FOUR]
    }
}
