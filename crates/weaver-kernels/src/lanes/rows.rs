//! Several rows of a matrix worked on side by side, so that the sum of one does not wait for that of another.

use super::{LANES, Lanes, split};

/// How many.
pub const ABREAST: usize = 4;

/// The whole vectors of a row.
type Whole<'a, T> = &'a [[T; LANES]];

/// The first R rows: their whole vectors, as many in each, and what is left of them, zeros beyond it.
#[inline(always)]
pub fn rows_of<V: Lanes, const R: usize>(cols: usize, x: &[V::Scalar]) -> ([Whole<'_, V::Scalar>; R], [V; R]) {
    let (mut whole, mut rest) = ([&[][..]; R], [V::zero(); R]);
    for r in 0..R {
        let (vectors, last) = split(&x[r * cols..][..cols]);
        (whole[r], rest[r]) = (&vectors[..cols / LANES], last);
    }
    (whole, rest)
}

/// The same to write to.
#[inline(always)]
pub fn rows_of_mut<T, const R: usize>(cols: usize, x: &mut [T]) -> [(&mut [[T; LANES]], &mut [T]); R] {
    let mut rows = x.chunks_exact_mut(cols);
    [(); R].map(
        #[inline(always)]
        |()| rows.next().expect("as many rows").as_chunks_mut(),
    )
}

/// The sums of the lanes of up to sixteen vectors.
#[inline(always)]
pub fn totals<V: Lanes, const R: usize>(of: [V; R]) -> [V::Scalar; R] {
    let mut vectors = [V::zero(); LANES];
    vectors[..R].copy_from_slice(&of);
    let sums = V::sums(&vectors).to_array();
    let mut out = [V::Scalar::default(); R];
    out.copy_from_slice(&sums[..R]);
    out
}
