//! Inner products of vectors of small whole numbers: the largest two of each row of a matrix of products, which is
//! never stored, and the products with chosen vectors.
//!
//! Vectors hold bytes up to 127 and have squared lengths below 2^16. Then no inner product exceeds 16 bits, by the
//! inequality of Cauchy and Schwarz, and neither does any part of it: sums stay in 16-bit lanes, twice as many as of 32
//! bits. All results are exact, hence the same with every instruction set.

mod tiles;

use crate::simd::level;
use tiles::Tile;

/// The largest byte of a vector.
pub const LARGEST: u8 = 127;
/// The largest squared length of a vector.
pub const LARGEST_SQUARE: u32 = u16::MAX as u32;
/// Vectors have a multiple of this many bytes.
pub const STEP: usize = 32;
/// Columns of a packed panel.
const PANEL: usize = 16;
/// Rows of a block: their bytes and their largest products stay in the first cache while panels pass by.
const BLOCK: usize = 72;
/// Columns that the 16 bits below a product can number.
const NUMBERED: usize = 1 << 16;

/// The largest two products of a row, lane by lane: a product in the upper 16 bits, the column counted down in the
/// lower ones, so that the first column wins among equal products.
type Largest = [[u32; PANEL]; 2];

/// The largest products of one row.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct TopTwo {
    /// The column of the largest; of equal ones the first.
    pub column: u32,
    /// The largest product.
    pub first: u32,
    /// The second largest, equal to the first if two columns share it; 0 if there is one column only.
    pub second: u32,
}

impl TopTwo {
    /// Takes a later column's products into account.
    fn insert(&mut self, column: u32, product: u32) {
        if product > self.first {
            *self = Self { column, first: product, second: self.first };
        } else {
            self.second = self.second.max(product);
        }
    }
}

/// The largest two products of every vector of `a` `[N, depth]` with the vectors of `b` `[M, depth]`, into `rows`
/// `[N]`, and the largest of every vector of `b` with the vectors of `a`, into `columns` `[M]`: the maxima of rows and
/// columns of A B^T in one pass.
///
/// Runs on the calling thread. Allocates a copy of `b`.
///
/// # Panics
///
/// If `depth` is not a multiple of [`STEP`] above 0, a length does not fit, or a vector is too long (see the module).
///
/// ```
/// use weaver_kernels::byte_products::{TopTwo, top_products};
/// let vector = |x: u8, y: u8| -> Vec<u8> { [x, y].into_iter().chain([0; 30]).collect() };
/// let (a, b) = (vector(3, 4), [vector(1, 1), vector(2, 5), vector(4, 4)].concat());
/// let (mut rows, mut columns) = ([TopTwo::default()], [0; 3]);
/// top_products(32, &a, &b, &mut rows, &mut columns);
/// assert_eq!(rows[0], TopTwo { column: 2, first: 28, second: 26 });
/// assert_eq!(columns, [7, 26, 28]);
/// ```
pub fn top_products(depth: usize, a: &[u8], b: &[u8], rows: &mut [TopTwo], columns: &mut [u32]) {
    assert!(depth > 0 && depth.is_multiple_of(STEP), "top_products: {depth} bytes, not a multiple of {STEP}");
    assert_eq!(a.len(), depth * rows.len(), "top_products: A is not [N, {depth}]");
    assert_eq!(b.len(), depth * columns.len(), "top_products: B is not [M, {depth}]");
    assert!(fit(depth, a) && fit(depth, b), "top_products: a byte above {LARGEST}, or a square above {LARGEST_SQUARE}");
    rows.fill(TopTwo::default());
    let tile = Tile::new(level());
    let bytes = NUMBERED * depth;
    for (number, (b, columns)) in b.chunks(bytes).zip(columns.chunks_mut(NUMBERED)).enumerate() {
        let panels = packed(depth, b);
        let mut maxima = vec![[0; PANEL]; columns.len().div_ceil(PANEL)];
        let mut block = vec![0; BLOCK * depth];
        for (a, rows) in a.chunks(BLOCK * depth).zip(rows.chunks_mut(BLOCK)) {
            block[..a.len()].copy_from_slice(a);
            // Rows of zeros change no maximum: no product is below 0.
            block[a.len()..].fill(0);
            let mut largest: [Largest; BLOCK] = [[[0; PANEL]; 2]; BLOCK];
            let used = rows.len().next_multiple_of(tile.rows());
            for ((i, panel), maxima) in panels.chunks_exact(PANEL * depth).enumerate().zip(&mut maxima) {
                let first = (NUMBERED - 1 - i * PANEL) as u32;
                let tiles = block[..used * depth].chunks_exact(tile.rows() * depth);
                for (a, largest) in tiles.zip(largest.chunks_exact_mut(tile.rows())) {
                    tile.run(a, panel, first, largest, maxima);
                }
            }
            for (row, largest) in rows.iter_mut().zip(&largest) {
                merge(row, largest, (number * NUMBERED) as u32);
            }
        }
        for (column, largest) in columns.iter_mut().zip(maxima.as_flattened()) {
            *column = largest >> 16;
        }
    }
}

/// The products of a vector with chosen vectors of `b` `[M, query.len()]`: `out[i]` belongs to vector `chosen[i]`.
///
/// # Panics
///
/// If the lengths of `query`, `b`, `chosen` and `out` do not fit, or a choice is beyond the end. Vectors that are too
/// long (see the module) are not checked for; their products mean nothing.
///
/// ```
/// use weaver_kernels::byte_products::chosen_products;
/// let (query, b) = ([2; 32], [[1; 32], [3; 32]].concat());
/// let mut out = [0; 3];
/// chosen_products(&query, &b, &[1, 0, 1], &mut out);
/// assert_eq!(out, [192, 64, 192]);
/// ```
pub fn chosen_products(query: &[u8], b: &[u8], chosen: &[u32], out: &mut [u32]) {
    let depth = query.len();
    assert!(depth > 0 && depth.is_multiple_of(STEP), "chosen_products: {depth} bytes, not a multiple of {STEP}");
    assert_eq!(chosen.len(), out.len(), "chosen_products: as many products as choices");
    let count = b.len() / depth;
    assert!(chosen.iter().all(|i| (*i as usize) < count), "chosen_products: a choice beyond {count} vectors");
    tiles::chosen(level(), query, b, chosen, out);
}

/// True if all vectors are as short as the module says.
fn fit(depth: usize, x: &[u8]) -> bool {
    crate::simd::dispatch(
        #[inline(always)]
        || {
            let mut fits = true;
            for x in x.chunks_exact(depth) {
                let (mut square, mut largest) = (0_u32, 0);
                for x in x {
                    square += u32::from(*x) * u32::from(*x);
                    largest = x.max(&largest).to_owned();
                }
                fits &= square <= LARGEST_SQUARE && largest <= LARGEST;
            }
            fits
        },
    )
}

/// Panels of 16 vectors, four bytes of each in turn: `[M / 16, depth / 4, 16, 4]`, filled up with zeros.
fn packed(depth: usize, b: &[u8]) -> Vec<u8> {
    let mut packed = vec![0; (b.len() / depth).next_multiple_of(PANEL) * depth];
    for (vectors, panel) in b.chunks(PANEL * depth).zip(packed.chunks_exact_mut(PANEL * depth)) {
        for (i, vector) in vectors.chunks_exact(depth).enumerate() {
            for (four, to) in vector.as_chunks::<4>().0.iter().zip(panel.as_chunks_mut::<{ 4 * PANEL }>().0) {
                to[4 * i..4 * i + 4].copy_from_slice(four);
            }
        }
    }
    packed
}

/// The largest two among the largest two of the lanes; columns are counted from `offset`.
fn merge(row: &mut TopTwo, [first, second]: &Largest, offset: u32) {
    let best = first.iter().copied().fold(0, u32::max);
    // Numbers of columns are different, so that the best is in one lane only.
    let next = first.iter().filter(|x| **x != best).chain(second).copied().fold(0, u32::max);
    let column = |key: u32| offset + (NUMBERED - 1) as u32 - (key & 0xffff);
    row.insert(column(best), best >> 16);
    row.insert(column(next), next >> 16);
}
