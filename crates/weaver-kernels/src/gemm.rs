//! Matrix multiplication, C = alpha A B + beta C, on row-major slices.
//!
//! C is cut into blocks, each a parallel task. Within it B is packed into panels, and rows of A into tiles, so that a tile of
//! C held in vector registers can stream through both. Whatever the blocks, every element of C is summed in the same order:
//! the same bits at any number of threads. Nothing is allocated but one packing buffer per thread, once.

use crate::extent::extent;
use crate::parallel::{Interleaved, for_ranges};
use crate::{Real, simd, simd::Level};
use std::ops::Range;

mod half_precision;
mod pack;
pub(crate) mod tile;

pub use half_precision::{Half, gemm_half, gemm_half_scratch_len};
use pack::{AHEAD, Stack};
pub(crate) use pack::{Panels, pack, transpose};

/// Rows of B that are summed before they are added to C. What is read of A and B for a tile comes from the second-level cache
/// in time, but C is read and written once more for each block of rows, so larger is faster; smaller is more exact, since
/// the rounding of a sum grows with the length of its chain.
const K_BLOCK: usize = 512;
/// The same where products are rounded before they are added.
const K_BLOCK_UNFUSED: usize = 256;
/// Rows of A that stay in the second-level cache with `K_BLOCK` columns.
const M_BLOCK: usize = 288;
/// Columns of B that stay in the third-level cache with as many rows.
const N_BLOCK: usize = 1024;
/// Rows of A that are a multiple of so many bytes apart fall into the same few sets of the first-level cache.
const CLASH: usize = 4096;
/// Panels of B that must follow for such rows, or columns, to be worth packing.
const REUSE: usize = 4;
/// Fewer rows are not worth packing B once more.
const M_TASK: usize = 48;
/// Fewer multiply-adds than this are not worth a parallel task.
const TASK: usize = 1 << 18;

/// A matrix operand: element (i, j) is `data[i * row_stride + j * col_stride]`.
#[derive(Clone, Copy, Debug)]
pub struct Mat<'a, T> {
    /// The elements, starting with (0, 0).
    pub data: &'a [T],
    /// Distance between neighboring rows.
    pub row_stride: usize,
    /// Distance between neighboring columns.
    pub col_stride: usize,
}

impl<'a, T: Real> Mat<'a, T> {
    /// A row-major matrix whose rows begin `stride` elements apart.
    #[inline]
    pub fn new(data: &'a [T], stride: usize) -> Self {
        Self { data, row_stride: stride, col_stride: 1 }
    }

    /// The transpose; nothing moves.
    #[inline]
    pub fn transposed(self) -> Self {
        Self { row_stride: self.col_stride, col_stride: self.row_stride, ..self }
    }

    fn check(&self, batch: usize, step: usize, rows: usize, cols: usize, name: &str) {
        let (reach, len) = (extent([(batch, step), (rows, self.row_stride), (cols, self.col_stride)]), self.data.len());
        let fits = reach.is_some_and(|reach| reach <= len);
        assert!(fits, "gemm: {name} is {batch} x {rows} x {cols} but its slice has {len} elements");
    }
}

/// C = alpha op(A) op(B) + beta C for contiguous row-major matrices.
///
/// op(A) is `m x k`: `a` holds `[m, k]`, or `[k, m]` if `trans_a`. op(B) is `k x n`: `b` holds
/// `[k, n]`, or `[n, k]` if `trans_b`. `c` is `[m, n]`; with `beta` 0 it is not read. Panics if a slice
/// is too short.
///
/// ```
/// use weaver_kernels::gemm::gemm;
/// let (a, b) = ([1.0, 2.0, 3.0, 4.0], [5.0, 6.0]); // A 2 x 2, B 2 x 1
/// let mut c = [f64::NAN; 2];
/// gemm(false, false, 2, 1, 2, 1.0, &a, &b, 0.0, &mut c);
/// assert_eq!(c, [17.0, 39.0]);
/// ```
pub fn gemm<T: Real>(
    trans_a: bool,
    trans_b: bool,
    m: usize,
    n: usize,
    k: usize,
    alpha: T,
    a: &[T],
    b: &[T],
    beta: T,
    c: &mut [T],
) {
    gemm_batched(1, trans_a, trans_b, m, n, k, alpha, a, 0, b, 0, beta, c, m * n);
}

/// [`gemm`] for `batch` triples of contiguous matrices that begin `a_stride`, `b_stride` and `c_stride`
/// elements apart. A stride of 0 shares A or B; `c_stride` is at least `m * n`.
pub fn gemm_batched<T: Real>(
    batch: usize,
    trans_a: bool,
    trans_b: bool,
    m: usize,
    n: usize,
    k: usize,
    alpha: T,
    a: &[T],
    a_stride: usize,
    b: &[T],
    b_stride: usize,
    beta: T,
    c: &mut [T],
    c_stride: usize,
) {
    let a = if trans_a { Mat::new(a, m).transposed() } else { Mat::new(a, k) };
    let b = if trans_b { Mat::new(b, k).transposed() } else { Mat::new(b, n) };
    b.check(batch, b_stride, k, n, "B");
    let b = Stack { mat: b, stride: b_stride };
    Product { batch, a_step: a_stride, c_step: c_stride, m, n, k, alpha, a, b: &b, beta, pairs: false }.run(c, n, true);
}

/// C = alpha A B + beta C for operands with any strides; `c` has rows `c_stride` >= `n` apart.
pub fn gemm_strided<T: Real>(
    m: usize,
    n: usize,
    k: usize,
    alpha: T,
    a: Mat<T>,
    b: Mat<T>,
    beta: T,
    c: &mut [T],
    c_stride: usize,
) {
    b.check(1, 0, k, n, "B");
    let b = Stack { mat: b, stride: 0 };
    Product { batch: 1, a_step: 0, c_step: 0, m, n, k, alpha, a, b: &b, beta, pairs: false }.run(c, c_stride, true);
}

/// [`gemm_strided`] on the calling thread alone, for use inside a parallel task.
pub fn gemm_serial<T: Real>(
    m: usize,
    n: usize,
    k: usize,
    alpha: T,
    a: Mat<T>,
    b: Mat<T>,
    beta: T,
    c: &mut [T],
    c_stride: usize,
) {
    b.check(1, 0, k, n, "B");
    let b = Stack { mat: b, stride: 0 };
    Product { batch: 1, a_step: 0, c_step: 0, m, n, k, alpha, a, b: &b, beta, pairs: false }.run(c, c_stride, false);
}

/// C = alpha A B + beta C, `batch` times.
pub(crate) struct Product<'a, T, B> {
    pub batch: usize,
    /// Distance between the A of batch entries; likewise C.
    pub a_step: usize,
    pub c_step: usize,
    pub m: usize,
    pub n: usize,
    pub k: usize,
    pub alpha: T,
    pub a: Mat<'a, T>,
    pub b: &'a B,
    pub beta: T,
    /// Whether numbers of A and B are pairs of bf16.
    pub pairs: bool,
}

impl<T: Real, B: Panels<T>> Product<'_, T, B> {
    /// Computes C, whose rows are `c_stride` apart.
    pub fn run(&self, c: &mut [T], c_stride: usize, parallel: bool) {
        let Self { batch, m, n, k, c_step, .. } = *self;
        if batch == 0 || m == 0 || n == 0 {
            return;
        }
        self.a.check(batch, self.a_step, m, k, "A");
        assert!(c_stride >= n, "gemm: rows of C overlap");
        let one = [(m, c_stride), (n, 1)];
        let apart = batch == 1 || extent(one).is_some_and(|len| len <= c_step);
        assert!(apart, "gemm: matrices of C overlap");
        let fits = extent([(batch, c_step), one[0], one[1]]).is_some_and(|len| len <= c.len());
        assert!(fits, "gemm: C is too short");

        let (rows, cols) = self.block_size(if parallel { rayon::current_num_threads() } else { 1 });
        let (down, across) = (m.div_ceil(rows), n.div_ceil(cols));
        let c = Interleaved::new(c);
        let block = |task: usize| {
            let (entry, block) = (task / (down * across), task % (down * across));
            let (i, j) = (block / across * rows, block % across * cols);
            // SAFETY: block (i, j) of matrix `entry` lies inside the slices, as asserted above, and no
            // other task has the same one.
            #[allow(unsafe_code)]
            unsafe {
                self.block(entry, i..m.min(i + rows), j..n.min(j + cols), &c, c_stride);
            }
        };
        let tasks = batch * down * across;
        if parallel {
            for_ranges(tasks, 1, |range| range.for_each(block));
        } else {
            (0..tasks).for_each(block);
        }
    }

    /// Rows and columns of a task's block of C: the longer side is halved until every thread has a task (more would pack more
    /// often), or until they are small. An element of C is summed in the same order whatever block it falls into.
    fn block_size(&self, threads: usize) -> (usize, usize) {
        let (tile_rows, tile_cols) = T::tile(simd::level());
        let (mut rows, mut cols) = (self.m, self.n.div_ceil(self.n.div_ceil(N_BLOCK)).next_multiple_of(tile_cols));
        loop {
            let tasks = self.batch * self.m.div_ceil(rows) * self.n.div_ceil(cols);
            if tasks >= threads || rows * cols * self.k < 2 * TASK {
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

    /// One block of C.
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
        c_stride: usize,
    ) {
        let level = simd::level();
        let (tile_rows, tile_cols) = T::tile(level);
        let a = &self.a.data[entry * self.a_step..];
        let offset = entry * self.c_step;
        // Tiles of nearly equal height keep the pipeline fuller than full tiles and a sliver; so do blocks of nearly equal
        // height and depth.
        let tiles = rows.len().div_ceil(tile_rows);
        let (height, taller) = (rows.len() / tiles, rows.len() % tiles);
        let first_row = |t: usize| rows.start + t * height + t.min(taller);
        let tile = |t: usize| first_row(t)..first_row(t + 1);
        let sweeps = tiles.div_ceil(M_BLOCK / tile_rows);
        let sweep = |s: usize| tiles * s / sweeps..tiles * (s + 1) / sweeps;
        let k_block = if level == Level::Portable { K_BLOCK_UNFUSED } else { K_BLOCK };
        let depth = self.k.max(1).div_ceil(self.k.max(1).div_ceil(k_block));
        let panels = cols.len().div_ceil(tile_cols);
        let packed =
            panels >= REUSE && (self.a.col_stride != 1 || (self.a.row_stride * size_of::<T>()).is_multiple_of(CLASH));
        let a_room = if packed { tiles.div_ceil(sweeps) * tile_rows * depth } else { 0 };
        let b_room = depth * tile_cols;
        T::with_panel(a_room + b_room * (1 + if sweeps > 1 { panels } else { 1 }), |room| {
            let (a_tiles, room) = room.split_at_mut(a_room);
            let (spare, b_panels) = room.split_at_mut(b_room);
            for k in (0..self.k.max(1)).step_by(depth) {
                let depth = depth.min(self.k - k);
                let beta = if k == 0 { self.beta } else { T::ONE };
                for s in 0..sweeps {
                    let first = tile(sweep(s).start).start;
                    if packed && depth > 0 {
                        let strides = [self.a.col_stride, self.a.row_stride];
                        // Where rows of tiles are neighbors in memory, all tiles take their part of a few lines, and then of
                        // the next, which were asked for meanwhile.
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
                        // The first sweep packs, the others find it packed.
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
                                let Mat { row_stride, col_stride, .. } = self.a;
                                let from = i * row_stride + k * col_stride;
                                (a.as_ptr().wrapping_add(from), a.len().saturating_sub(from), [row_stride, col_stride])
                            };
                            let last = (height - 1) * strides[0] + depth.saturating_sub(1) * strides[1];
                            debug_assert!(depth == 0 || last < readable, "gemm reads A beyond its end");
                            debug_assert!(depth * padded <= panel.len(), "gemm reads its panel beyond the end");
                            let at = offset + i * c_stride + j;
                            debug_assert!(
                                at + (height - 1) * c_stride + width <= c.len(),
                                "gemm writes C beyond its end"
                            );
                            // SAFETY: rows i..i+height of A, packed or not, and of C and columns j..j+width of C are
                            // inside their slices; the panel holds depth * padded elements: asserted in debug builds.
                            unsafe {
                                let (size, panel, c) = ([height, width, depth], panel.as_ptr(), c.pointer(at));
                                if self.pairs {
                                    T::multiply_pairs(size, from, strides, panel, beta, c, c_stride);
                                } else {
                                    T::multiply(level, size, self.alpha, from, strides, panel, beta, c, c_stride);
                                }
                            }
                        }
                    }
                }
            }
        });
    }
}
