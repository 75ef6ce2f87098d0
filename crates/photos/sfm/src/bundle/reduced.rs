//! The reduced equations of cameras and lenses, once the points are eliminated.

#![expect(clippy::needless_range_loop, reason = "numbers in registers go side by side through several arrays")]

use super::linear::fma;
use super::structure::{Blocks, NONE, Part};
use super::sums::{BLOCK, Coupling, PADDED};
use super::system::{Block, Row, System};
use std::ops::Range;
use weaver_kernels::parallel;
use weaver_kernels::simd::{self, Level};

/// Most groups of rows: tasks that each own their rows.
const GROUPS: usize = 64;
/// Products of blocks below which a task of its own does not pay off.
const PRODUCTS: usize = 2048;
/// A pivot over its diagonal element below which rounding alone holds a point.
const HELD: f64 = 1e-15;

/// Consecutive rows of the lower half of the matrix: only blocks with a point in common.
#[derive(Clone, Debug, Default)]
pub(super) struct Group {
    pub rows: Range<usize>,
    /// Start of each row's blocks, and the end of the last row's.
    first: Vec<u32>,
    /// The column of each block, ascending; the last of a row is on the diagonal.
    columns: Vec<u32>,
    values: Vec<Block>,
    right: Vec<Row>,
    /// Places of the current row's blocks, by column.
    place: Vec<u32>,
}

/// The reduced equations.
#[derive(Clone, Debug)]
pub(super) struct Reduced {
    pub groups: Vec<Group>,
    /// The group of each row.
    of_row: Vec<u32>,
    pub rows: usize,
}

impl Reduced {
    pub fn new(blocks: &Blocks, system: &System, parts: &[Part]) -> Self {
        let mut work = vec![1_usize; blocks.count];
        for part in parts {
            for point in 0..part.points.len() {
                part.entries(point).enumerate().for_each(|(i, entry)| work[part.block[entry] as usize] += i + 1);
            }
        }
        let all: usize = work.iter().sum();
        let most = all.div_ceil((all / PRODUCTS).clamp(1, GROUPS));
        let mut groups: Vec<Group> = Vec::new();
        let (mut of_row, mut sum) = (Vec::new(), most);
        for (row, work) in work.iter().enumerate() {
            if sum >= most {
                groups.push(Group { rows: row..row, ..Group::default() });
                sum = 0;
            }
            sum += work;
            of_row.push(groups.len() as u32 - 1);
            groups.last_mut().expect("just pushed").rows.end = row + 1;
        }
        parallel::for_chunks(&mut groups, 1, |_, groups| groups.iter_mut().for_each(|g| g.connect(system, parts)));
        Self { groups, of_row, rows: blocks.count }
    }

    /// Number of stored blocks.
    pub fn stored(&self) -> usize {
        self.groups.iter().map(|g| g.columns.len()).sum()
    }

    /// Fills matrix and right side for a damping, for which the inverses of points are ready.
    pub fn fill(&mut self, system: &System, parts: &[Part], damping: f64) {
        parallel::for_chunks(&mut self.groups, 1, |_, groups| {
            for group in groups {
                if simd::level() == Level::Portable {
                    group.fill::<false>(system, parts, damping);
                } else {
                    simd::dispatch(
                        #[inline(always)]
                        || group.fill::<true>(system, parts, damping),
                    );
                }
            }
        });
    }

    /// The blocks of a row, each with its column.
    #[inline(always)]
    pub fn row(&self, row: usize) -> (&[u32], &[Block]) {
        self.groups[self.of_row[row] as usize].row(row)
    }

    /// The right side of a row.
    #[inline(always)]
    pub fn right(&self, row: usize) -> &Row {
        let group = &self.groups[self.of_row[row] as usize];
        &group.right[row - group.rows.start]
    }
}

impl Group {
    fn row(&self, row: usize) -> (&[u32], &[Block]) {
        let row = row - self.rows.start;
        let range = self.first[row] as usize..self.first[row + 1] as usize;
        (&self.columns[range.clone()], &self.values[range])
    }

    /// Finds the blocks of its rows.
    fn connect(&mut self, system: &System, parts: &[Part]) {
        self.place = vec![NONE; system.right.len()];
        for row in self.rows.clone() {
            let first = self.columns.len();
            self.first.push(first as u32);
            let mut connect = |column: u32| {
                let place = &mut self.place[column as usize];
                // Each column once: the mark of the row says that it is there.
                if *place != row as u32 {
                    *place = row as u32;
                    self.columns.push(column);
                }
            };
            for part in parts {
                for [entry, point] in part.of_block(row) {
                    // Only the lower half: the entries of a point ascend by block.
                    let before = part.entries(*point as usize).start..*entry as usize;
                    part.block[before].iter().for_each(|b| connect(*b));
                }
            }
            Some(system.lens[row]).filter(|lens| *lens != NONE).into_iter().for_each(&mut connect);
            connect(row as u32);
            self.columns[first..].sort_unstable();
        }
        self.first.push(self.columns.len() as u32);
        self.values = vec![Block::default(); self.columns.len()];
        self.right = vec![[0.0; PADDED]; self.rows.len()];
    }

    #[inline(always)]
    fn fill<const FUSED: bool>(&mut self, system: &System, parts: &[Part], damping: f64) {
        self.values.fill(Block::default());
        for (row, number) in self.rows.clone().enumerate() {
            let range = self.first[row] as usize..self.first[row + 1] as usize;
            for (place, column) in range.clone().zip(&self.columns[range.clone()]) {
                self.place[*column as usize] = place as u32;
            }
            let diagonal = &mut self.values[range.end - 1];
            *diagonal = system.matrix[number];
            for i in 0..BLOCK {
                // An unknown without observations has 1 in `system.diagonal` and 0 in the matrix.
                diagonal.0[i][i] = system.diagonal[number][i] * (1.0 + damping);
            }
            if system.lens[number] != NONE {
                self.values[self.place[system.lens[number] as usize] as usize] = system.with_lens[number];
            }
            let mut right = system.right[number];
            for part in parts {
                for &[entry, point] in part.of_block(number) {
                    let (entry, point) = (entry as usize, point as usize);
                    let solved = solved::<FUSED>(&part.coupling[entry], &part.inverse[point]);
                    let by_point = &part.right[point];
                    for b in 0..PADDED {
                        for k in 0..3 {
                            right[b] = fma::<FUSED>(solved[k][b], by_point[k], right[b]);
                        }
                    }
                    for other in part.first_entry[point] as usize..=entry {
                        let place = self.place[part.block[other] as usize] as usize;
                        add::<FUSED>(&mut self.values[place], &solved, &part.coupling[other]);
                    }
                }
            }
            self.right[row] = right;
        }
    }
}

/// Minus a coupling times the inverse matrix of its point.
#[inline(always)]
fn solved<const FUSED: bool>(coupling: &Coupling, inverse: &[f64; 6]) -> [[f64; PADDED]; 3] {
    let [xx, xy, xz, yy, yz, zz] = *inverse;
    let columns = [[-xx, -xy, -xz], [-xy, -yy, -yz], [-xz, -yz, -zz]];
    let mut solved = [[0.0; PADDED]; 3];
    for k in 0..3 {
        for b in 0..PADDED {
            let two = fma::<FUSED>(coupling.0[0][b], columns[k][0], coupling.0[1][b] * columns[k][1]);
            solved[k][b] = fma::<FUSED>(coupling.0[2][b], columns[k][2], two);
        }
    }
    solved
}

/// Adds the product of a solved coupling and another one.
#[inline(always)]
fn add<const FUSED: bool>(block: &mut Block, solved: &[[f64; PADDED]; 3], other: &Coupling) {
    for a in 0..BLOCK {
        let row = &mut block.0[a];
        let x = [solved[0][a], solved[1][a], solved[2][a]];
        for b in 0..PADDED {
            let sum = fma::<FUSED>(x[0], other.0[0][b], row[b]);
            row[b] = fma::<FUSED>(x[2], other.0[2][b], fma::<FUSED>(x[1], other.0[1][b], sum));
        }
    }
}

impl Part {
    /// Inverts the damped matrices of its points.
    pub fn invert(&mut self, damping: f64) {
        for (inverse, matrix) in self.inverse.iter_mut().zip(&self.matrix) {
            *inverse = damped_inverse(matrix, damping);
        }
    }
}

/// By Cholesky's factors; zero if the matrix is not positive definite.
fn damped_inverse(matrix: &[f64; 6], damping: f64) -> [f64; 6] {
    let [xx, xy, xz, yy, yz, zz] = *matrix;
    let more = 1.0 + damping;
    let (xx, yy, zz) = (xx * more, yy * more, zz * more);
    let (l10, l20) = (xy / xx, xz / xx);
    let d1 = yy - l10 * xy;
    let off = yz - l10 * xz;
    let l21 = off / d1;
    let d2 = zz - l20 * xz - l21 * off;
    // False for NaN, too.
    let held = xx > 0.0 && d1 > HELD * yy && d2 > HELD * zz;
    if !held {
        // Such a point stays where it is, and has no part in the step of cameras.
        return [0.0; 6];
    }
    // The inverse of the unit lower factor, and of the diagonal.
    let m20 = l10 * l21 - l20;
    let (i0, i1, i2) = (1.0 / xx, 1.0 / d1, 1.0 / d2);
    let cross = m20 * i2;
    [i0 + l10 * l10 * i1 + m20 * cross, -l10 * i1 - l21 * cross, cross, i1 + l21 * l21 * i2, -l21 * i2, i2]
}
