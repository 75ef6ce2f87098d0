//! Processing of several rows of a matrix together, so that their sums, which are independent, hide each other's
//! latency.

use super::{LANES, Lanes, split};

/// Number of rows processed together.
pub const GROUP: usize = 4;

/// The whole vectors of a row.
type Whole<'a, T> = &'a [[T; LANES]];

/// The first R rows as whole vectors and one last vector each of the remaining elements, filled up with zeros.
#[inline(always)]
pub fn rows_of<V: Lanes, const R: usize>(cols: usize, x: &[V::Scalar]) -> ([Whole<'_, V::Scalar>; R], [V; R]) {
    let (mut whole, mut rest) = ([&[][..]; R], [V::zero(); R]);
    for r in 0..R {
        let (vectors, last) = split(&x[r * cols..][..cols]);
        (whole[r], rest[r]) = (&vectors[..cols / LANES], last);
    }
    (whole, rest)
}

/// The first R rows to write: whole vectors and the remaining elements of each.
#[inline(always)]
pub fn rows_of_mut<T, const R: usize>(cols: usize, x: &mut [T]) -> [(&mut [[T; LANES]], &mut [T]); R] {
    let mut rows = x.chunks_exact_mut(cols);
    [(); R].map(
        #[inline(always)]
        |()| rows.next().expect("as many rows").as_chunks_mut(),
    )
}

/// The horizontal sums of up to sixteen vectors.
#[inline(always)]
pub fn totals<V: Lanes, const R: usize>(of: [V; R]) -> [V::Scalar; R] {
    let mut vectors = [V::zero(); LANES];
    vectors[..R].copy_from_slice(&of);
    let sums = V::sums(&vectors).to_array();
    let mut out = [V::Scalar::default(); R];
    out.copy_from_slice(&sums[..R]);
    out
}
