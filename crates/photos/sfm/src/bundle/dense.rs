//! Cholesky's factors of a dense matrix, by panels of columns.

use super::reduced::Reduced;
use super::sums::BLOCK;
use super::system::Row;
use weaver_kernels::gemm::{Mat, MatMut, gemm};
use weaver_kernels::simd;

/// Columns of a panel.
const WIDTH: usize = 16 * BLOCK;
/// Sums side by side, which the processor adds at once.
const LANES: usize = 16;

/// A lower triangle, and the factor that takes its place.
#[derive(Clone, Debug, Default)]
pub(super) struct Dense {
    size: usize,
    /// Each panel from the diagonal down, row by row.
    panels: Vec<Vec<f64>>,
    /// The inverse of the upper end of a panel, and the rows solved by it.
    inverse: Vec<f64>,
    below: Vec<f64>,
    x: Vec<f64>,
}

impl Dense {
    pub fn new(size: usize) -> Self {
        let panel = |first: usize| vec![0.0; (size - first) * WIDTH.min(size - first)];
        let panels: Vec<Vec<f64>> = (0..size).step_by(WIDTH).map(panel).collect();
        let below = panels.first().map_or(0, Vec::len);
        Self { size, panels, inverse: vec![0.0; WIDTH * WIDTH], below: vec![0.0; below], x: vec![0.0; size] }
    }

    /// Solves the reduced equations; `false` if their matrix is not positive definite.
    pub fn solve(&mut self, reduced: &Reduced, step: &mut [Row]) -> bool {
        self.load(reduced);
        if !self.factor() {
            return false;
        }
        for (row, x) in self.x.chunks_exact_mut(BLOCK).enumerate() {
            x.copy_from_slice(&reduced.right(row)[..BLOCK]);
        }
        let mut x = std::mem::take(&mut self.x);
        self.substitute(&mut x);
        self.x = x;
        for (step, x) in step.iter_mut().zip(self.x.chunks_exact(BLOCK)) {
            step[..BLOCK].copy_from_slice(x);
        }
        true
    }

    /// Copies the lower triangle.
    fn load(&mut self, reduced: &Reduced) {
        self.panels.iter_mut().for_each(|panel| panel.fill(0.0));
        for row in 0..reduced.rows {
            let (columns, blocks) = reduced.row(row);
            for (column, block) in columns.iter().zip(blocks) {
                self.add(row, *column as usize, |a, b| block.0[a][b]);
            }
        }
    }

    /// Adds a block of the lower triangle.
    #[inline]
    pub fn add(&mut self, row: usize, column: usize, block: impl Fn(usize, usize) -> f64) {
        let (row, panel, column) = (row * BLOCK, column * BLOCK / WIDTH, column * BLOCK % WIDTH);
        let first = panel * WIDTH;
        let width = WIDTH.min(self.size - first);
        for a in 0..BLOCK {
            let to = &mut self.panels[panel][(row + a - first) * width + column..][..BLOCK];
            to.iter_mut().enumerate().for_each(|(b, x)| *x += block(a, b));
        }
    }

    /// The factor; `false` if the matrix is not positive definite.
    pub fn factor(&mut self) -> bool {
        for panel in 0..self.panels.len() {
            let first = panel * WIDTH;
            let width = WIDTH.min(self.size - first);
            let rows = self.size - first;
            let (before, rest) = self.panels.split_at_mut(panel);
            let this = &mut rest[0];
            for (k, other) in before.iter().enumerate() {
                // Rows of the panel before that are at the height of this one.
                let other = &other[(first - k * WIDTH) * WIDTH..];
                let left = Mat::new(other, rows, WIDTH);
                let right = Mat::new(&other[..width * WIDTH], width, WIDTH).transposed();
                gemm(-1.0, left, right, 1.0, MatMut::new(this, rows, width));
            }
            let (upper, lower) = this.split_at_mut(width * width);
            let definite = simd::dispatch(
                #[inline(always)]
                || factor(upper, width),
            );
            if !definite {
                return false;
            }
            if rows > width {
                let inverse = &mut self.inverse[..width * width];
                invert(upper, width, inverse);
                let below = &mut self.below[..lower.len()];
                below.copy_from_slice(lower);
                let (left, right) = (Mat::new(below, rows - width, width), Mat::new(inverse, width, width));
                gemm(1.0, left, right.transposed(), 0.0, MatMut::new(lower, rows - width, width));
            }
        }
        true
    }

    /// An element of the diagonal of the inverse, from the factor: the square of a column of the inverse of the factor.
    /// `x` has as many elements as the matrix has rows.
    pub fn inverse_diagonal(&self, at: usize, x: &mut [f64]) -> f64 {
        x.fill(0.0);
        x[at] = 1.0;
        simd::dispatch(
            #[inline(always)]
            || {
                self.forward(at / WIDTH, x);
                dot(&x[at..], &x[at..])
            },
        )
    }

    /// Solves by the factor and its transpose.
    fn substitute(&self, x: &mut [f64]) {
        simd::dispatch(
            #[inline(always)]
            || {
                self.forward(0, x);
                self.backward(x);
            },
        );
    }

    /// Solves by the factor; `x` is zero above a panel.
    #[inline(always)]
    fn forward(&self, from: usize, x: &mut [f64]) {
        for (panel, data) in self.panels.iter().enumerate().skip(from) {
            let width = WIDTH.min(self.size - panel * WIDTH);
            let (here, below) = x[panel * WIDTH..].split_at_mut(width);
            for (i, row) in data.chunks_exact(width).take(width).enumerate() {
                here[i] = (here[i] - dot(&row[..i], &here[..i])) / row[i];
            }
            for (x, row) in below.iter_mut().zip(data.chunks_exact(width).skip(width)) {
                *x -= dot(row, here);
            }
        }
    }

    /// Solves by the transpose of the factor.
    #[inline(always)]
    fn backward(&self, x: &mut [f64]) {
        for (panel, data) in self.panels.iter().enumerate().rev() {
            let width = WIDTH.min(self.size - panel * WIDTH);
            let (here, below) = x[panel * WIDTH..].split_at_mut(width);
            for (x, row) in below.iter().zip(data.chunks_exact(width).skip(width)) {
                subtract(here, row, *x);
            }
            for (i, row) in data.chunks_exact(width).take(width).enumerate().rev() {
                here[i] /= row[i];
                let above = here[i];
                subtract(&mut here[..i], &row[..i], above);
            }
        }
    }
}

/// The factor of a small matrix, row by row.
#[inline(always)]
fn factor(matrix: &mut [f64], n: usize) -> bool {
    for i in 0..n {
        let (above, row) = matrix.split_at_mut(i * n);
        let row = &mut row[..n];
        for j in 0..i {
            let other = &above[j * n..][..n];
            row[j] = (row[j] - dot(&row[..j], &other[..j])) / other[j];
        }
        let rest = row[i] - dot(&row[..i], &row[..i]);
        if rest.is_nan() || rest <= 0.0 {
            return false;
        }
        row[i] = rest.sqrt();
        row[i + 1..].fill(0.0);
    }
    true
}

/// The inverse of a lower triangle, row by row.
fn invert(factor: &[f64], n: usize, inverse: &mut [f64]) {
    inverse.fill(0.0);
    for i in 0..n {
        let (above, row) = inverse.split_at_mut(i * n);
        let pivot = 1.0 / factor[i * n + i];
        for k in 0..i {
            let x = factor[i * n + k] * pivot;
            subtract(&mut row[..=k], &above[k * n..][..=k], x);
        }
        row[i] = pivot;
    }
}

/// a -= x b.
#[inline(always)]
fn subtract(a: &mut [f64], b: &[f64], x: f64) {
    for (a, b) in a.iter_mut().zip(b) {
        *a -= x * b;
    }
}

#[inline(always)]
fn dot(a: &[f64], b: &[f64]) -> f64 {
    let mut sums = [0.0; LANES];
    let ((a, a_rest), (b, b_rest)) = (a.as_chunks::<LANES>(), b.as_chunks::<LANES>());
    for (a, b) in a.iter().zip(b) {
        for i in 0..LANES {
            sums[i] += a[i] * b[i];
        }
    }
    let mut sum = 0.0;
    for (a, b) in a_rest.iter().zip(b_rest) {
        sum += a * b;
    }
    for width in [8, 4, 2, 1] {
        for i in 0..width {
            sums[i] += sums[i + width];
        }
    }
    sum + sums[0]
}
