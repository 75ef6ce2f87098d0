//! Matrix multiplication, C = alpha A B + beta C, on row-major slices.
//!
//! C is cut into blocks whose borders depend on the sizes alone; a block is one parallel task. Within
//! it a panel of B is packed so that a tile of C held in vector registers can stream through it, and
//! every element of C is summed in one fixed order: the same bits at any number of threads. Nothing is
//! allocated but one packing buffer per thread, once.

use crate::lanes::{self, LANES, LaneKernel, Lanes};
use crate::parallel::for_ranges;
use crate::{Real, simd};
use std::ops::Range;

mod half_precision;
pub(crate) mod tile;

pub use half_precision::{gemm_bf16, widen};

/// Rows of a B panel that stay in the first-level cache.
const K_BLOCK: usize = 256;
/// Rows of A that stay in the second-level cache with `K_BLOCK` columns.
const M_BLOCK: usize = 384;
/// Panels of B that must follow for rows of A to be worth packing: rows far apart in memory fall into the same sets of the
/// caches, and each is a page of its own.
const REUSE: usize = 4;
/// Fewer rows are not worth packing B once more.
const M_TASK: usize = 48;
/// Fewer multiply-adds than this are not worth a parallel task.
const TASK: usize = 1 << 18;
/// As many tasks as this are enough for any machine we know.
const TASKS: usize = 16;

/// A matrix operand: element (i, j) is `data[i * row_stride + j * col_stride]`.
#[derive(Clone, Copy, Debug)]
pub struct Mat<'a, T> {
    /// The elements, starting with (0, 0).
    pub data: &'a [T],
    /// Distance between neighbouring rows.
    pub row_stride: usize,
    /// Distance between neighbouring columns.
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
        if batch > 0 && rows > 0 && cols > 0 {
            let last = (batch - 1) * step + (rows - 1) * self.row_stride + (cols - 1) * self.col_stride;
            let len = self.data.len();
            assert!(last < len, "gemm: {name} is {batch} x {rows} x {cols} but its slice has {len} elements");
        }
    }
}

/// Where [`Product`] gets B from: a matrix in memory, or one that is made as it is packed.
pub(crate) trait Panels<T>: Sync {
    /// Writes rows `k`, columns `cols` of matrix `entry` to `panel`, rows of `padded` elements, zeros
    /// behind the columns. `spare` is as long as the largest panel and free to use.
    fn pack(&self, entry: usize, k: Range<usize>, cols: Range<usize>, padded: usize, panel: &mut [T], spare: &mut [T]);
}

/// Matrices that begin `stride` apart.
struct Stack<'a, T> {
    mat: Mat<'a, T>,
    stride: usize,
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
    Product { batch, a_step: a_stride, c_step: c_stride, m, n, k, alpha, a, b: &b, beta }.run(c, n, true);
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
    Product { batch: 1, a_step: 0, c_step: 0, m, n, k, alpha, a, b: &b, beta }.run(c, c_stride, true);
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
    Product { batch: 1, a_step: 0, c_step: 0, m, n, k, alpha, a, b: &b, beta }.run(c, c_stride, false);
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
}

/// C, shared by tasks that write disjoint blocks of it.
#[derive(Clone, Copy)]
struct Output<T> {
    start: *mut T,
    len: usize,
}

#[allow(unsafe_code)]
// SAFETY: every task derives pointers to its own block only; `Product::run` makes the blocks disjoint.
unsafe impl<T: Send> Sync for Output<T> {}

impl<T: Real, B: Panels<T>> Product<'_, T, B> {
    /// Computes C, whose rows are `c_stride` apart.
    pub fn run(&self, c: &mut [T], c_stride: usize, parallel: bool) {
        let Self { batch, m, n, k, c_step, .. } = *self;
        if batch == 0 || m == 0 || n == 0 {
            return;
        }
        self.a.check(batch, self.a_step, m, k, "A");
        assert!(c_stride >= n, "gemm: rows of C overlap");
        let c_len = (m - 1) * c_stride + n;
        assert!(batch == 1 || c_step >= c_len, "gemm: matrices of C overlap");
        assert!((batch - 1) * c_step + c_len <= c.len(), "gemm: C is too short");

        let (rows, cols) = if parallel { self.block_size() } else { (M_BLOCK, n) };
        let (down, across) = (m.div_ceil(rows), n.div_ceil(cols));
        let c = Output { start: c.as_mut_ptr(), len: c.len() };
        let block = |task: usize| {
            let (entry, block) = (task / (down * across), task % (down * across));
            let (i, j) = (block / across * rows, block % across * cols);
            // SAFETY: block (i, j) of matrix `entry` lies inside the slices, as asserted above, and no
            // other task has the same one.
            #[allow(unsafe_code)]
            unsafe {
                self.block(entry, i..m.min(i + rows), j..n.min(j + cols), c, c_stride);
            }
        };
        let tasks = batch * down * across;
        if parallel {
            for_ranges(tasks, 1, |range| range.for_each(block));
        } else {
            (0..tasks).for_each(block);
        }
    }

    /// Rows and columns of a task's block of C: halved until there are enough tasks or they are small.
    /// Splitting columns is free, splitting rows packs B again.
    fn block_size(&self) -> (usize, usize) {
        let (tile_rows, tile_cols) = T::tile(simd::level());
        let (mut rows, mut cols) = (self.m.div_ceil(self.m.div_ceil(M_BLOCK)), self.n);
        loop {
            let tasks = self.batch * self.m.div_ceil(rows) * self.n.div_ceil(cols);
            if tasks >= TASKS || rows * cols * self.k < 2 * TASK {
                return (rows, cols);
            }
            if cols > tile_cols {
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
    unsafe fn block(&self, entry: usize, rows: Range<usize>, cols: Range<usize>, c: Output<T>, c_stride: usize) {
        let level = simd::level();
        let (tile_rows, tile_cols) = T::tile(level);
        let a = &self.a.data[entry * self.a_step..];
        let (offset, block_start) = (entry * self.c_step, rows.start);
        // Tiles of nearly equal height keep the pipeline fuller than full tiles and a sliver.
        let tiles = rows.len().div_ceil(tile_rows);
        let tile = |t: usize| rows.start + rows.len() * t / tiles..rows.start + rows.len() * (t + 1) / tiles;
        // So do blocks of nearly equal depth.
        let depth = self.k.max(1).div_ceil(self.k.max(1).div_ceil(K_BLOCK));
        let packed = cols.len() >= REUSE * tile_cols;
        let room = if packed { rows.len() * depth } else { 0 };
        T::with_panel(room + 2 * depth * tile_cols, |panel| {
            let (a_tiles, panel) = panel.split_at_mut(room);
            let (panel, spare) = panel.split_at_mut(depth * tile_cols);
            for k in (0..self.k.max(1)).step_by(depth) {
                let depth = depth.min(self.k - k);
                let beta = if k == 0 { self.beta } else { T::ONE };
                if packed && depth > 0 {
                    let (p_stride, i_stride) = (self.a.col_stride, self.a.row_stride);
                    for rows in (0..tiles).map(tile) {
                        let from = &a[rows.start * i_stride + k * p_stride..];
                        let into = &mut a_tiles[(rows.start - block_start) * depth..][..rows.len() * depth];
                        pack(from, [p_stride, i_stride], depth, rows.len(), rows.len(), into);
                    }
                }
                for j in cols.clone().step_by(tile_cols) {
                    let width = tile_cols.min(cols.end - j);
                    let padded = T::panel_width(level, width);
                    let into = &mut panel[..depth * padded];
                    self.b.pack(entry, k..k + depth, j..j + width, padded, into, spare);
                    for rows in (0..tiles).map(tile) {
                        let (i, height) = (rows.start, rows.len());
                        let (from, readable, strides) = if packed {
                            let from = (i - block_start) * depth;
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
                        debug_assert!(at + (height - 1) * c_stride + width <= c.len, "gemm writes C beyond its end");
                        // SAFETY: rows i..i+height of A, packed or not, and of C and columns j..j+width of C are
                        // inside their slices; the panel holds depth * padded elements: asserted in debug builds.
                        unsafe {
                            T::multiply(
                                level,
                                [height, width, depth],
                                self.alpha,
                                from,
                                strides,
                                panel.as_ptr(),
                                beta,
                                c.start.add(at),
                                c_stride,
                            );
                        }
                    }
                }
            }
        });
    }
}

impl<T: Real> Panels<T> for Stack<'_, T> {
    fn pack(
        &self,
        entry: usize,
        k: Range<usize>,
        cols: Range<usize>,
        padded: usize,
        panel: &mut [T],
        _spare: &mut [T],
    ) {
        if k.is_empty() {
            return;
        }
        let (width, depth) = (cols.len(), k.len());
        let Mat { data, row_stride, col_stride } = self.mat;
        let data = &data[entry * self.stride + k.start * row_stride + cols.start * col_stride..];
        pack(data, [row_stride, col_stride], depth, width, padded, panel);
    }
}

/// `out[p * padded + q] = data[p * strides[0] + q * strides[1]]`, zeros from `q = width` on.
fn pack<T: Real>(data: &[T], strides: [usize; 2], depth: usize, width: usize, padded: usize, out: &mut [T]) {
    let [row_stride, col_stride] = strides;
    if col_stride == 1 {
        for (p, out) in out.chunks_exact_mut(padded).enumerate() {
            out[..width].copy_from_slice(&data[p * row_stride..][..width]);
            out[width..].fill(T::ZERO);
        }
    } else {
        transpose(data, row_stride, col_stride, depth, width, padded, out);
    }
}

/// `out[p * padded + q] = data[p * row_stride + q * col_stride]`, zeros from `q = width` on.
pub(crate) fn transpose<T: Real>(
    data: &[T],
    row_stride: usize,
    col_stride: usize,
    depth: usize,
    width: usize,
    padded: usize,
    out: &mut [T],
) {
    if width < padded {
        out.fill(T::ZERO);
    }
    let mut done = (0, 0);
    if row_stride == 1 {
        let transpose = Transpose { data, col_stride, depth, width, padded, out: &mut *out };
        done = lanes::run(transpose);
    }
    for q in 0..width {
        let from = if q < done.1 { done.0 } else { 0 };
        for p in from..depth {
            out[p * padded + q] = data[p * row_stride + q * col_stride];
        }
    }
}

/// [`transpose`] of contiguous columns, sixteen by sixteen in registers.
struct Transpose<'a, T> {
    data: &'a [T],
    col_stride: usize,
    depth: usize,
    width: usize,
    padded: usize,
    out: &'a mut [T],
}

impl<T: Real> LaneKernel<T> for Transpose<'_, T> {
    /// Rows and columns that were done.
    type Output = (usize, usize);

    #[inline(always)]
    fn run<V: Lanes<Scalar = T>>(self) -> (usize, usize) {
        let Self { data, col_stride, depth, width, padded, out } = self;
        let rows = depth / LANES * LANES;
        // A single block of fewer columns may write beyond them: the next row comes after it and overwrites that.
        let alone = width < LANES && padded == width;
        let cols = if alone { width } else { width / LANES * LANES };
        for q in (0..cols).step_by(LANES) {
            for p in (0..rows).step_by(LANES) {
                let mut block = [V::zero(); LANES];
                for (i, column) in block.iter_mut().enumerate() {
                    let from = (q + i).min(cols - 1) * col_stride + p;
                    *column = V::load(data[from..].first_chunk().expect("rows of sixteen"));
                }
                V::transpose(&mut block);
                for (i, row) in block.iter().enumerate() {
                    let to = &mut out[(p + i) * padded + q..];
                    match to.first_chunk_mut() {
                        Some(to) => row.store(to),
                        None => to.copy_from_slice(&row.to_array()[..to.len()]),
                    }
                }
            }
        }
        (rows, cols)
    }
}
