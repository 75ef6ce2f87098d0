//! Matrix multiplication, C = alpha A B + beta C.
//!
//! C is divided into blocks, each a parallel task. Within a block, B is packed into panels, and as many rows of A as
//! fit into the second-level cache are multiplied by each of them. A is packed too where its own layout would be slow.
//! A tile of C, held in vector registers, then reads both sequentially. Every element of C is summed in the same order
//! at any block size, so the bits are the same at any number of threads and with caches of any size. Each thread keeps
//! one packing buffer, which grows to the largest product; nothing else is allocated.

use crate::parallel::{Interleaved, for_ranges};
use crate::{Real, caches, simd, simd::Level};
use std::ops::Range;

mod half_precision;
mod matrix;
mod pack;
#[cfg(target_arch = "x86_64")]
mod pairs;
pub(crate) mod tile;

pub use half_precision::{Half, gemm_half, gemm_half_scratch_len};
pub use matrix::{Batch, Mat, MatMut};
pub(crate) use pack::{Panels, pack, transpose};
use tile::{LeftOperand, OutputRows};

/// Rows of B that are summed before they are added to C. A larger block reads and writes C less often. A smaller one is
/// more accurate, since the rounding error of a sum grows with its length. The order of a sum is part of its bits;
/// therefore this size, unlike the others, depends on the instruction set alone and not on the caches.
const fn k_block(level: Level) -> usize {
    match level {
        // A and B arrive from the second-level cache in time.
        Level::Avx512 => 512,
        // A panel of B is at most three quarters of the smallest first-level cache, 32 KiB.
        Level::Avx2 | Level::Neon => 384,
        // There is no fused multiply-add, and products are rounded before they are added.
        Level::Portable => 256,
    }
}

/// The most bytes of A that are read again and again from the second-level cache.
const A_BLOCK: usize = 1 << 19;
/// Columns of B that stay in the third-level cache with a block of rows.
const N_BLOCK: usize = 1024;
/// Rows of A that lie a multiple of this many bytes apart share a few sets of the first-level cache and evict each
/// other.
const CLASH: usize = 4096;
/// Number of panels of B from which packing such rows, or columns, of A pays off.
const REUSE: usize = 4;
/// Bytes of a row of B that are packed together, in several panels: each takes a cache line or two, and rows are often
/// a page apart.
const ROW_PART: usize = 1024;
/// Rows of which such a part is packed before the next rows follow.
const ROWS_IN_TURN: usize = 16;
/// Multiply-adds below which a parallel task does not pay off.
const TASK: usize = 1 << 18;
/// Multiply-adds in the time in which one number is packed.
const PACKING: usize = 16;

/// C = alpha A B + beta C, in parallel.
///
/// `a` is m x k, `b` k x n and `c` m x n, each with strides of its own; [`Mat::transposed`] multiplies by a transpose.
/// With `beta` 0, C is not read.
///
/// # Panics
///
/// If the shapes do not fit each other, a slice is too short, or rows of C overlap.
///
/// ```
/// use weaver_kernels::gemm::{Mat, MatMut, gemm};
/// let (a, b) = ([1.0, 2.0, 3.0, 4.0], [5.0, 6.0]);
/// let mut c = [f64::NAN; 2];
/// gemm(1.0, Mat::new(&a, 2, 2), Mat::new(&b, 2, 1), 0.0, MatMut::new(&mut c, 2, 1));
/// assert_eq!(c, [17.0, 39.0]);
/// ```
pub fn gemm<T: Real>(alpha: T, a: Mat<T>, b: Mat<T>, beta: T, c: MatMut<T>) {
    gemm_batched(1, alpha, a.batch(0), b.batch(0), beta, c.batch(0));
}

/// [`gemm`] on the calling thread alone, for use inside a parallel task.
pub fn gemm_serial<T: Real>(alpha: T, a: Mat<T>, b: Mat<T>, beta: T, c: MatMut<T>) {
    multiply(1, alpha, a.batch(0), b.batch(0), beta, c.batch(0), false);
}

/// [`gemm`] for `batch` triples of matrices, in parallel.
///
/// A and B may have a [stride](Batch::stride) of 0, which shares the matrix among all products; the matrices of C must
/// not overlap.
///
/// ```
/// use weaver_kernels::gemm::{Mat, MatMut, gemm_batched};
/// let (rows, shared) = ([1.0, 2.0, 3.0, 4.0], [10.0, 1.0]);
/// let mut c = [0.0; 2];
/// let (a, b) = (Mat::new(&rows, 1, 2).batch(2), Mat::new(&shared, 2, 1).batch(0));
/// gemm_batched(2, 1.0, a, b, 0.0, MatMut::new(&mut c, 1, 1).batch(1));
/// assert_eq!(c, [12.0, 34.0]);
/// ```
pub fn gemm_batched<T: Real>(batch: usize, alpha: T, a: Batch<Mat<T>>, b: Batch<Mat<T>>, beta: T, c: Batch<MatMut<T>>) {
    multiply(batch, alpha, a, b, beta, c, true);
}

#[inline(never)]
fn multiply<T: Real>(
    batch: usize,
    alpha: T,
    a: Batch<Mat<T>>,
    b: Batch<Mat<T>>,
    beta: T,
    c: Batch<MatMut<T>>,
    parallel: bool,
) {
    b.check(batch, "B");
    let (rows, cols) = (b.first.rows, b.first.cols);
    assert_eq!(
        (rows, cols),
        (a.first.cols, c.first.cols),
        "gemm: rows and columns of B, of which A and C need as many"
    );
    let follow_on = |stride, rows: usize, row_stride| rows.checked_mul(row_stride) == Some(stride);
    let m = a.first.rows;
    if batch > 1
        && b.stride == 0
        && m == c.first.rows
        && follow_on(a.stride, m, a.first.row_stride)
        && follow_on(c.stride, m, c.first.row_stride)
    {
        // Matrices that share B and whose rows follow on one another are one matrix: B is packed once.
        let (a, c) = (Mat { rows: batch * m, ..a.first }, MatMut { rows: batch * m, ..c.first });
        return Product { alpha, a: a.batch(0), b: &b, beta, pairs: false }.run(1, c.batch(0), parallel);
    }
    Product { alpha, a, b: &b, beta, pairs: false }.run(batch, c, parallel);
}

/// C = alpha A B + beta C for every matrix of a batch.
pub(crate) struct Product<'a, T, B> {
    pub alpha: T,
    pub a: Batch<Mat<'a, T>>,
    pub b: &'a B,
    pub beta: T,
    /// True if every number of A and B is a pair of bf16.
    pub pairs: bool,
}

impl<T: Real, B: Panels<T>> Product<'_, T, B> {
    /// Computes `batch` matrices C.
    pub fn run(&self, batch: usize, c: Batch<MatMut<T>>, parallel: bool) {
        let (m, n) = (c.first.rows, c.first.cols);
        assert_eq!(self.a.first.rows, m, "gemm: rows of A and of C");
        if batch == 0 || m == 0 || n == 0 {
            return;
        }
        self.a.check(batch, "A");
        c.check(batch);

        let threads = if parallel { rayon::current_num_threads() } else { 1 };
        let (rows, cols) = self.block_size([batch, m, n], threads);
        let (down, across) = (m.div_ceil(rows), n.div_ceil(cols));
        let (stride, row_stride) = (c.stride, c.first.row_stride);
        let c = Interleaved::new(c.first.data);
        let block = |task: usize| {
            let (entry, block) = (task / (down * across), task % (down * across));
            let (i, j) = (block / across * rows, block % across * cols);
            // SAFETY: block (i, j) of matrix `entry` lies inside the slices, as asserted above, and no
            // other task has the same one.
            #[allow(unsafe_code)]
            unsafe {
                self.block(entry, i..m.min(i + rows), j..n.min(j + cols), &c, [stride, row_stride]);
            }
        };
        let tasks = batch * down * across;
        if parallel {
            for_ranges(tasks, 1, |range| range.for_each(block));
        } else {
            (0..tasks).for_each(block);
        }
    }

    /// Rows and columns of the block of C that a task computes: those that `threads` threads finish first, where each
    /// task packs its rows of A and columns of B. Elements of C are summed in the same order at any block size.
    fn block_size(&self, [batch, m, n]: [usize; 3], threads: usize) -> (usize, usize) {
        let (tile_rows, tile_cols) = T::tile(simd::level());
        let blocks = |down: usize, across: usize| {
            let across = across.max(n.div_ceil(N_BLOCK));
            (m.div_ceil(down).next_multiple_of(tile_rows), n.div_ceil(across).next_multiple_of(tile_cols))
        };
        let time = |&(rows, cols): &(usize, usize)| {
            let tasks = batch * m.div_ceil(rows) * n.div_ceil(cols);
            tasks.div_ceil(threads) * (rows * cols + PACKING * (rows + cols))
        };
        let worth = batch.saturating_mul(m).saturating_mul(n).saturating_mul(self.a.first.cols) / TASK;
        let wanted = threads.min(worth).div_ceil(batch).max(1);
        let sizes = (1..=wanted).map(|down| blocks(down, wanted.div_ceil(down)));
        sizes.min_by_key(time).unwrap_or_else(|| blocks(1, 1))
    }

    /// Computes one block of C.
    ///
    /// # Safety
    /// The block must lie inside C and belong to the caller alone.
    #[allow(unsafe_code)]
    unsafe fn block(
        &self,
        entry: usize,
        rows: Range<usize>,
        cols: Range<usize>,
        c: &Interleaved<'_, T>,
        [c_step, c_stride]: [usize; 2],
    ) {
        let level = simd::level();
        let (tile_rows, tile_cols) = T::tile(level);
        let Mat { data, cols: k_end, row_stride, col_stride, .. } = self.a.first;
        let a = &data[entry * self.a.stride..];
        let offset = entry * c_step;
        let depth = k_end.max(1).div_ceil(k_end.max(1).div_ceil(k_block(level)));
        // Tiles of nearly equal height use the pipeline better than full tiles followed by a thin one. The same goes
        // for the height and depth of blocks.
        let tiles = rows.len().div_ceil(tile_rows);
        let (height, taller) = (rows.len() / tiles, rows.len() % tiles);
        let first_row = |t: usize| rows.start + t * height + t.min(taller);
        let tile = |t: usize| first_row(t)..first_row(t + 1);
        let room = A_BLOCK.min(caches::second_level() / 2);
        let sweeps = tiles.div_ceil((room / (depth * size_of::<T>() * tile_rows)).max(1));
        let sweep = |s: usize| tiles * s / sweeps..tiles * (s + 1) / sweeps;
        let panels = cols.len().div_ceil(tile_cols);
        let packed = panels >= REUSE && (col_stride != 1 || (row_stride * size_of::<T>()).is_multiple_of(CLASH));
        // An odd number of cache lines, so that rows do not share sets of the first-level cache.
        let line = 64 / size_of::<T>();
        let a_stride = (depth.div_ceil(line) | 1) * line;
        let a_room = if packed { tiles.div_ceil(sweeps) * tile_rows * a_stride } else { 0 };
        let b_room = depth * tile_cols;
        let (group, turn) = match self.b.in_turn() {
            true => (ROW_PART / (tile_cols * size_of::<T>()), ROWS_IN_TURN),
            false => (1, depth),
        };
        let slots = if sweeps > 1 { panels } else { group.min(panels) };
        let columns = |panel: usize| cols.start + panel * tile_cols..cols.end.min(cols.start + (panel + 1) * tile_cols);
        T::with_panel(a_room + b_room * (1 + slots), |room| {
            let (a_rows, room) = room.split_at_mut(a_room);
            let (spare, b_panels) = room.split_at_mut(b_room);
            for k in (0..k_end.max(1)).step_by(depth) {
                let depth = depth.min(k_end - k);
                let beta = if k == 0 { self.beta } else { T::ONE };
                for s in 0..sweeps {
                    let first = first_row(sweep(s).start);
                    if packed && depth > 0 {
                        let from = &a[first * row_stride + k * col_stride..];
                        let rows = first_row(sweep(s).end) - first;
                        pack(from, [row_stride, col_stride], rows, depth, a_stride, a_rows);
                    }
                    for panel in 0..panels {
                        // The first sweep packs the panels; the others reuse them.
                        if s == 0 && panel % group == 0 {
                            for p in (0..depth).step_by(turn) {
                                let run = turn.min(depth - p);
                                for panel in panel..panels.min(panel + group) {
                                    let cols = columns(panel);
                                    let padded = T::panel_width(level, cols.len());
                                    let to = &mut b_panels[panel % slots * b_room + p * padded..][..run * padded];
                                    self.b.pack(entry, k + p..k + p + run, cols, padded, to, spare);
                                }
                            }
                        }
                        let (j, width) = (columns(panel).start, columns(panel).len());
                        let padded = T::panel_width(level, width);
                        let panel = &b_panels[panel % slots * b_room..][..depth * padded];
                        for rows in sweep(s).map(tile) {
                            let (i, height) = (rows.start, rows.len());
                            let (from, readable, strides) = if packed {
                                let from = (i - first) * a_stride;
                                (a_rows[from..].as_ptr(), a_rows.len() - from, [a_stride, 1])
                            } else {
                                let from = i * row_stride + k * col_stride;
                                (a.as_ptr().wrapping_add(from), a.len().saturating_sub(from), [row_stride, col_stride])
                            };
                            let last = (height - 1) * strides[0] + depth.saturating_sub(1) * strides[1];
                            debug_assert!(depth == 0 || last < readable, "gemm reads beyond the end of A");
                            debug_assert!(depth * padded <= panel.len(), "gemm reads beyond the end of its panel");
                            let at = offset + i * c_stride + j;
                            debug_assert!(
                                at + (height - 1) * c_stride + width <= c.len(),
                                "gemm writes beyond the end of C"
                            );
                            // SAFETY: rows i..i+height of A, packed or not, and of C, and columns j..j+width of C, lie
                            // inside their slices; the panel holds depth * padded elements. Asserted in debug builds.
                            unsafe {
                                let a = LeftOperand { start: from, strides };
                                let c = OutputRows { start: c.pointer(at), stride: c_stride };
                                let (size, panel) = ([height, width, depth], panel.as_ptr());
                                if self.pairs {
                                    T::multiply_pairs(size, a, panel, beta, c);
                                } else {
                                    T::multiply(level, size, self.alpha, a, panel, beta, c);
                                }
                            }
                        }
                    }
                }
            }
        });
    }
}
