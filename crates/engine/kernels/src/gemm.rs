//! Matrix multiplication, C = alpha A B + beta C.
//!
//! C is divided into blocks, each a parallel task. Within a block, B is packed into panels and A, where it helps, into
//! tiles, so that a tile of C held in vector registers reads both sequentially. Every element of C is summed in the
//! same order at any block size, so the bits are the same at any number of threads. Each thread keeps one packing
//! buffer, which grows to the largest product; nothing else is allocated.

use crate::parallel::{Interleaved, for_ranges};
use crate::{Real, simd, simd::Level};
use std::ops::Range;

mod half_precision;
mod matrix;
mod pack;
pub(crate) mod tile;

pub use half_precision::{Half, gemm_half, gemm_half_scratch_len};
pub use matrix::{Batch, Mat, MatMut};
use pack::AHEAD;
pub(crate) use pack::{Panels, pack, transpose};
use tile::{LeftOperand, OutputRows};

/// Rows of B that are summed before they are added to C. A and B arrive from the second-level cache in time, but C is
/// read and written once more for each block of rows, so a larger block is faster. A smaller one is more accurate,
/// since the rounding error of a sum grows with its length.
const K_BLOCK: usize = 512;
/// Replaces [`K_BLOCK`] where there is no fused multiply-add, and products are rounded before they are added.
const K_BLOCK_UNFUSED: usize = 256;
/// Rows of A that stay in the second-level cache with `K_BLOCK` columns.
const M_BLOCK: usize = 288;
/// Columns of B that stay in the third-level cache with `K_BLOCK` rows.
const N_BLOCK: usize = 1024;
/// Rows of A that lie a multiple of this many bytes apart share a few sets of the first-level cache and evict each
/// other.
const CLASH: usize = 4096;
/// Number of panels of B from which packing such rows, or columns, of A pays off.
const REUSE: usize = 4;
/// With fewer rows than this, packing B for one more task does not pay off.
const M_TASK: usize = 48;
/// Multiply-adds below which a parallel task does not pay off.
const TASK: usize = 1 << 18;

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

    /// Rows and columns of the block of C that a task computes. The longer side is halved until every thread has a
    /// task, or until blocks are small; more tasks than threads would only pack more often. Elements of C are summed in
    /// the same order at any block size.
    fn block_size(&self, [batch, m, n]: [usize; 3], threads: usize) -> (usize, usize) {
        let (tile_rows, tile_cols) = T::tile(simd::level());
        let (mut rows, mut cols) = (m, n.div_ceil(n.div_ceil(N_BLOCK)).next_multiple_of(tile_cols));
        loop {
            let tasks = batch * m.div_ceil(rows) * n.div_ceil(cols);
            if tasks >= threads || rows * cols * self.a.first.cols < 2 * TASK {
                return (rows, cols);
            }
            if cols > tile_cols && (cols >= rows || rows <= M_TASK) {
                cols = (cols / 2).next_multiple_of(tile_cols);
            } else if rows > M_TASK {
                rows = (rows / 2).next_multiple_of(tile_rows);
            } else {
                return (rows, cols);
            }
        }
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
        // Tiles of nearly equal height use the pipeline better than full tiles followed by a thin one. The same goes
        // for the height and depth of blocks.
        let tiles = rows.len().div_ceil(tile_rows);
        let (height, taller) = (rows.len() / tiles, rows.len() % tiles);
        let first_row = |t: usize| rows.start + t * height + t.min(taller);
        let tile = |t: usize| first_row(t)..first_row(t + 1);
        let sweeps = tiles.div_ceil(M_BLOCK / tile_rows);
        let sweep = |s: usize| tiles * s / sweeps..tiles * (s + 1) / sweeps;
        let k_block = if level == Level::Portable { K_BLOCK_UNFUSED } else { K_BLOCK };
        let depth = k_end.max(1).div_ceil(k_end.max(1).div_ceil(k_block));
        let panels = cols.len().div_ceil(tile_cols);
        let packed = panels >= REUSE && (col_stride != 1 || (row_stride * size_of::<T>()).is_multiple_of(CLASH));
        let a_room = if packed { tiles.div_ceil(sweeps) * tile_rows * depth } else { 0 };
        let b_room = depth * tile_cols;
        T::with_panel(a_room + b_room * (1 + if sweeps > 1 { panels } else { 1 }), |room| {
            let (a_tiles, room) = room.split_at_mut(a_room);
            let (spare, b_panels) = room.split_at_mut(b_room);
            for k in (0..k_end.max(1)).step_by(depth) {
                let depth = depth.min(k_end - k);
                let beta = if k == 0 { self.beta } else { T::ONE };
                for s in 0..sweeps {
                    let first = tile(sweep(s).start).start;
                    if packed && depth > 0 {
                        let strides = [col_stride, row_stride];
                        // Where the rows of A are adjacent in memory, all tiles pack their part of a few cache lines
                        // before any of them moves on to the next lines, which were prefetched meanwhile.
                        let run = if strides[1] == 1 { AHEAD } else { depth };
                        for p in (0..depth).step_by(run) {
                            let run = run.min(depth - p);
                            for rows in sweep(s).map(tile) {
                                let from = &a[rows.start * strides[1] + (k + p) * strides[0]..];
                                let height = rows.len();
                                let into = &mut a_tiles[(rows.start - first) * depth + p * height..][..run * height];
                                pack(from, strides, run, height, height, into);
                            }
                        }
                    }
                    for (panel, j) in cols.clone().step_by(tile_cols).enumerate() {
                        let width = tile_cols.min(cols.end - j);
                        let padded = T::panel_width(level, width);
                        // The first sweep packs the panel; the others reuse it.
                        let slot = if sweeps > 1 { panel * b_room } else { 0 };
                        let panel = &mut b_panels[slot..][..depth * padded];
                        if s == 0 {
                            self.b.pack(entry, k..k + depth, j..j + width, padded, panel, spare);
                        }
                        for rows in sweep(s).map(tile) {
                            let (i, height) = (rows.start, rows.len());
                            let (from, readable, strides) = if packed {
                                let from = (i - first) * depth;
                                (a_tiles[from..].as_ptr(), a_tiles.len() - from, [1, height])
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
