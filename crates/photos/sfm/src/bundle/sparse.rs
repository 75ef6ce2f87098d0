//! The reduced equations by conjugate gradients; only blocks with points in common are stored.

#![expect(clippy::needless_range_loop, reason = "numbers in registers go side by side through several arrays")]

use super::reduced::Reduced;
use super::sums::{BLOCK, PADDED};
use super::system::{Block, Row};
use weaver_kernels::dense::cholesky;
use weaver_kernels::{parallel, simd};

/// Rows of a task.
const ROWS: usize = 32;

/// The blocks below the diagonal, column by column.
#[derive(Clone, Debug)]
struct Below {
    /// Where the blocks of each column begin in `blocks`, and where the last end.
    first: Vec<u32>,
    /// The row of each, and its place within the row.
    blocks: Vec<[u32; 2]>,
}

impl Below {
    #[inline(always)]
    fn column(&self, column: usize) -> &[[u32; 2]] {
        &self.blocks[self.first[column] as usize..self.first[column + 1] as usize]
    }
}

/// State of conjugate gradients beside the matrix.
#[derive(Clone, Debug)]
pub(super) struct Sparse {
    below: Below,
    /// Inverses of the diagonal blocks.
    inverse: Vec<Block>,
    residual: Vec<Row>,
    direction: Vec<Row>,
    product: Vec<Row>,
    solved: Vec<Row>,
    /// Residual over the right side, in the norm of the inverse diagonal, that is small enough, and most iterations.
    tolerance: f64,
    most: usize,
}

impl Sparse {
    pub fn new(reduced: &Reduced, tolerance: f64, most: usize) -> Self {
        let n = reduced.rows;
        let mut first = vec![0; n + 1];
        let columns = |row: usize| reduced.row(row).0.iter().map(|c| *c as usize).filter(move |c| *c != row);
        (0..n).for_each(|row| columns(row).for_each(|column| first[column + 1] += 1));
        (0..n).for_each(|i| first[i + 1] += first[i]);
        let mut next = first.clone();
        let mut blocks = vec![[0; 2]; first[n] as usize];
        for row in 0..n {
            for (place, column) in columns(row).enumerate() {
                blocks[next[column] as usize] = [row as u32, place as u32];
                next[column] += 1;
            }
        }
        let rows = vec![[0.0; PADDED]; n];
        Self {
            below: Below { first, blocks },
            inverse: vec![Block::default(); n],
            residual: rows.clone(),
            direction: rows.clone(),
            product: rows.clone(),
            solved: rows,
            tolerance,
            most,
        }
    }

    /// Solves the reduced equations; `false` if their matrix is not positive definite.
    ///
    /// Source: Hestenes and Stiefel, Methods of conjugate gradients for solving linear systems, 1952; with the inverses
    /// of the diagonal blocks in front.
    pub fn solve(&mut self, reduced: &Reduced, step: &mut [Row]) -> bool {
        (0..reduced.rows).for_each(|row| self.residual[row] = *reduced.right(row));
        self.solve_residual(reduced, step)
    }

    /// Solves for another right side than the equations' own.
    pub fn solve_for(&mut self, reduced: &Reduced, right: &[Row], step: &mut [Row]) -> bool {
        self.residual.copy_from_slice(right);
        self.solve_residual(reduced, step)
    }

    fn solve_residual(&mut self, reduced: &Reduced, step: &mut [Row]) -> bool {
        if !self.invert(reduced) {
            return false;
        }
        step.fill([0.0; PADDED]);
        self.precondition();
        self.direction.copy_from_slice(&self.solved);
        let mut now = dot(&self.residual, &self.solved);
        let enough = self.tolerance * self.tolerance * now;
        for _ in 0..self.most {
            if now.is_nan() || now <= enough {
                break;
            }
            self.multiply(reduced);
            let curvature = dot(&self.direction, &self.product);
            // Not positive definite along this direction.
            if curvature.is_nan() || curvature <= 0.0 {
                return false;
            }
            let by = now / curvature;
            add(step, by, &self.direction);
            add(&mut self.residual, -by, &self.product);
            self.precondition();
            let next = dot(&self.residual, &self.solved);
            let keep = next / now;
            now = next;
            for (d, s) in self.direction.as_flattened_mut().iter_mut().zip(self.solved.as_flattened()) {
                *d = s + keep * *d;
            }
        }
        now.is_finite()
    }

    /// The diagonals of the inverses of the diagonal blocks; `None` if one is not positive definite.
    pub fn inverse_diagonals(&mut self, reduced: &Reduced) -> Option<Vec<Row>> {
        let diagonal = |block: &Block| {
            let mut row = [0.0; PADDED];
            (0..BLOCK).for_each(|k| row[k] = block.0[k][k]);
            row
        };
        self.invert(reduced).then(|| self.inverse.iter().map(diagonal).collect())
    }

    fn invert(&mut self, reduced: &Reduced) -> bool {
        let diagonal = |row: usize| reduced.row(row).1.last().expect("a diagonal block");
        let mut rows = self.inverse.iter_mut().enumerate();
        rows.all(|(row, inverse)| inverted(diagonal(row)).map(|found| *inverse = found).is_some())
    }

    fn precondition(&mut self) {
        for ((solved, residual), inverse) in self.solved.iter_mut().zip(&self.residual).zip(&self.inverse) {
            *solved = [0.0; PADDED];
            // The inverse is symmetric.
            times_transposed(solved, inverse, residual);
        }
    }

    /// The product of the matrix and the direction. Each row is summed by one task, in the order of columns.
    fn multiply(&mut self, reduced: &Reduced) {
        let Self { below, direction, product, .. } = self;
        parallel::for_chunks(product, ROWS, |chunk, product| {
            simd::dispatch(
                #[inline(always)]
                || multiply_rows(reduced, below, direction, chunk * ROWS, product),
            );
        });
    }
}

/// The product of some rows of the matrix and a direction.
#[inline(always)]
fn multiply_rows(reduced: &Reduced, below: &Below, direction: &[Row], first: usize, product: &mut [Row]) {
    for (row, product) in (first..).zip(product) {
        *product = [0.0; PADDED];
        let (columns, blocks) = reduced.row(row);
        let mut sums = Block::default();
        for (column, block) in columns.iter().zip(blocks) {
            let x = &direction[*column as usize];
            for a in 0..BLOCK {
                for b in 0..PADDED {
                    sums.0[a][b] += block.0[a][b] * x[b];
                }
            }
        }
        for a in 0..BLOCK {
            product[a] = sums.0[a].iter().sum();
        }
        for &[other, place] in below.column(row) {
            let block = &reduced.row(other as usize).1[place as usize];
            times_transposed(product, block, &direction[other as usize]);
        }
    }
}

/// y += block^T x.
#[inline(always)]
fn times_transposed(y: &mut Row, block: &Block, x: &Row) {
    for (row, x) in block.0.iter().zip(x) {
        for (y, a) in y.iter_mut().zip(row) {
            *y += a * x;
        }
    }
}

/// a += by b.
fn add(a: &mut [Row], by: f64, b: &[Row]) {
    a.as_flattened_mut().iter_mut().zip(b.as_flattened()).for_each(|(a, b)| *a += by * b);
}

fn dot(a: &[Row], b: &[Row]) -> f64 {
    let mut sums = [0.0; PADDED];
    a.iter().zip(b).for_each(|(a, b)| (0..PADDED).for_each(|i| sums[i] += a[i] * b[i]));
    sums.iter().sum()
}

/// The inverse of a block, by Cholesky's factors; `None` if it is not positive definite.
fn inverted(block: &Block) -> Option<Block> {
    let mut l = block.0;
    if !cholesky(l.as_flattened_mut(), BLOCK, PADDED) {
        return None;
    }
    // The inverse of the factor, row by row.
    let mut m = [[0.0; BLOCK]; BLOCK];
    for i in 0..BLOCK {
        for j in 0..=i {
            let unit = f64::from(i == j);
            m[i][j] = (unit - (j..i).map(|k| l[i][k] * m[k][j]).sum::<f64>()) / l[i][i];
        }
    }
    let mut inverse = Block::default();
    for a in 0..BLOCK {
        for b in 0..BLOCK {
            inverse.0[a][b] = (a.max(b)..BLOCK).map(|k| m[k][a] * m[k][b]).sum();
        }
    }
    Some(inverse)
}

#[cfg(test)]
mod tests {
    use super::*;
    use weaver_kernels::random::Stream;

    #[test]
    fn a_block_times_its_inverse_is_the_identity() {
        for seed in 0..50 {
            let stream = Stream::new(seed, 0, "test.block");
            let a: [[f64; BLOCK]; BLOCK] =
                std::array::from_fn(|i| std::array::from_fn(|j| stream.normal((BLOCK * i + j) as u64)));
            let mut block = Block::default();
            for i in 0..BLOCK {
                for j in 0..BLOCK {
                    block.0[i][j] = (0..BLOCK).map(|k| a[i][k] * a[j][k]).sum::<f64>() + 0.1 * f64::from(i == j);
                }
            }
            let inverse = inverted(&block).expect("a positive definite block");
            for i in 0..BLOCK {
                for j in 0..BLOCK {
                    let product: f64 = (0..BLOCK).map(|k| block.0[i][k] * inverse.0[k][j]).sum();
                    assert!((product - f64::from(i == j)).abs() < 1e-9, "{seed}: {product} at {i}, {j}");
                    assert_eq!(inverse.0[i][j], inverse.0[j][i]);
                }
                assert_eq!(inverse.0[i][BLOCK..], [0.0; PADDED - BLOCK]);
            }
            block.0[seed as usize % BLOCK][seed as usize % BLOCK] = -1.0;
            assert!(inverted(&block).is_none());
        }
    }
}
