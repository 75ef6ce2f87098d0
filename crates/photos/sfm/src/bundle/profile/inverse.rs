//! The part of the inverse of a sparse matrix that is stored as its factor is.

use super::Profile;
use crate::bundle::sums::{BLOCK, PADDED};
use crate::bundle::system::Row;
use weaver_kernels::{parallel, simd};

/// Blocks of a column that a task finds.
const GRAIN: usize = 16;

type Square = [[f64; BLOCK]; BLOCK];

impl Profile {
    /// The diagonal of the inverse, from the factor, whose place the inverse takes as far as it is stored there.
    ///
    /// With L the factor, the inverse Z is found from its last column on: `Z_ij = d_ij (L_jj L_jj^T)^-1 - sum_k>j Z_ik
    /// L_kj L_jj^-1` needs only stored blocks, in as many products as the factor took.
    ///
    /// Source: Takahashi, Fagan and Chen, Formation of a sparse bus impedance matrix and its application to short
    /// circuit study, 1973.
    pub fn inverse_diagonal(&mut self) -> Vec<Row> {
        let n = self.first.len();
        let mut by_place = vec![[0.0; PADDED]; n];
        // Of each column the rows that reach it.
        let mut reaching: Vec<Vec<u32>> = vec![Vec::new(); n];
        for row in 0..n {
            (self.first[row] as usize..row).for_each(|column| reaching[column].push(row as u32));
        }
        let mut multipliers = vec![[[0.0; BLOCK]; BLOCK]; n];
        let mut found: Vec<Square> = Vec::new();
        for column in (0..n).rev() {
            let rows = &reaching[column];
            let pivot = inverse_of_lower(&self.block(column, column));
            rows.iter().for_each(|row| {
                multipliers[*row as usize] = product(&self.block(*row as usize, column), &pivot);
            });
            found.clear();
            found.resize(rows.len(), [[0.0; BLOCK]; BLOCK]);
            parallel::for_chunks(&mut found, GRAIN, |chunk, found| {
                simd::dispatch(
                    #[inline(always)]
                    || {
                        for (row, sum) in rows[chunk * GRAIN..].iter().zip(found) {
                            *sum = self.column_of_inverse(*row as usize, rows, &multipliers);
                        }
                    },
                );
            });
            let mut diagonal = [[0.0; BLOCK]; BLOCK];
            subtract(&mut diagonal, &pivot, &pivot, true);
            diagonal.as_flattened_mut().iter_mut().for_each(|x| *x = -*x);
            for (row, found) in rows.iter().zip(&found) {
                subtract(&mut diagonal, found, &multipliers[*row as usize], true);
            }
            self.put(column, column, &diagonal);
            rows.iter().zip(&found).for_each(|(row, found)| self.put(*row as usize, column, found));
            (0..BLOCK).for_each(|k| by_place[column][k] = diagonal[k][k]);
        }
        self.place.iter().map(|place| by_place[*place as usize]).collect()
    }

    /// Minus the sum of the blocks of a row of the inverse, in these columns, times the multipliers of the same rows.
    #[inline(always)]
    fn column_of_inverse(&self, row: usize, others: &[u32], multipliers: &[Square]) -> Square {
        let mut sum = [[0.0; BLOCK]; BLOCK];
        for other in others.iter().map(|other| *other as usize) {
            if other <= row {
                subtract(&mut sum, &self.block(row, other), &multipliers[other], false);
            } else {
                subtract(&mut sum, &self.block(other, row), &multipliers[other], true);
            }
        }
        sum
    }

    /// A block that is stored, by places.
    #[inline(always)]
    fn block(&self, row: usize, column: usize) -> Square {
        let (width, from) = self.within(row, column);
        std::array::from_fn(|a| {
            let values: &[f64; BLOCK] = self.values[from + width * a..][..BLOCK].try_into().expect("a row of a block");
            *values
        })
    }

    fn put(&mut self, row: usize, column: usize, block: &Square) {
        let (width, from) = self.within(row, column);
        block.iter().enumerate().for_each(|(a, x)| self.values[from + width * a..][..BLOCK].copy_from_slice(x));
    }

    /// Index of an entry by the length of the rows of its place.
    #[inline(always)]
    fn within(&self, row: usize, column: usize) -> (usize, usize) {
        (self.width(row), self.start[row] + BLOCK * (column - self.first[row] as usize))
    }
}

/// Subtracts the product of a block, or of its transpose, and another one.
#[inline(always)]
fn subtract(sum: &mut Square, x: &Square, y: &Square, transposed: bool) {
    for a in 0..BLOCK {
        for k in 0..BLOCK {
            let by = if transposed { x[k][a] } else { x[a][k] };
            (0..BLOCK).for_each(|b| sum[a][b] -= by * y[k][b]);
        }
    }
}

fn product(x: &Square, y: &Square) -> Square {
    let mut product = [[0.0; BLOCK]; BLOCK];
    subtract(&mut product, x, y, false);
    product.map(|row| row.map(|x| -x))
}

/// The inverse of the lower triangle of a block.
fn inverse_of_lower(lower: &Square) -> Square {
    let mut inverse = [[0.0; BLOCK]; BLOCK];
    for column in 0..BLOCK {
        inverse[column][column] = 1.0 / lower[column][column];
        for row in column + 1..BLOCK {
            let sum: f64 = (column..row).map(|k| lower[row][k] * inverse[k][column]).sum();
            inverse[row][column] = -sum / lower[row][row];
        }
    }
    inverse
}
