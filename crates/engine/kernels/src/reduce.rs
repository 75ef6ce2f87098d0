//! Sums and dot products whose order of addition depends on the length alone.

use crate::parallel::for_chunks;
use crate::target::{Target, put};
use crate::{Real, simd};

/// Number of interleaved partial sums, which the compiler can keep in the lanes of vectors.
const LANES: usize = 16;
/// Elements summed by one task.
const CHUNK: usize = 1 << 14;
/// Number of chunks whose sums are kept on the stack at a time.
const CHUNKS: usize = 64;

/// The sum of `chunk(range)` over chunks of `0..n`, in parallel, added in a fixed order.
#[inline(always)]
fn total<T: Real>(n: usize, chunk: impl Fn(std::ops::Range<usize>) -> T + Sync) -> T {
    let mut sum = T::ZERO;
    for group in (0..n).step_by(CHUNK * CHUNKS) {
        let end = n.min(group + CHUNK * CHUNKS);
        let mut partial = [T::ZERO; CHUNKS];
        let partial = &mut partial[..(end - group).div_ceil(CHUNK)];
        for_chunks(partial, 1, |i, partial| {
            let from = group + i * CHUNK;
            partial[0] = chunk(from..end.min(from + CHUNK));
        });
        sum += pairwise(partial);
    }
    sum
}

/// Pairwise summation: the rounding error grows with log n.
fn pairwise<T: Real>(x: &[T]) -> T {
    match x {
        [] => T::ZERO,
        [x] => *x,
        _ => {
            let (a, b) = x.split_at(x.len() / 2);
            pairwise(a) + pairwise(b)
        }
    }
}

/// The sum of `term` over the elements of slices of equal length, in 16 interleaved partial sums.
#[inline(always)]
pub(crate) fn lanes<T: Real, const K: usize>(x: [&[T]; K], term: impl Fn([T; K]) -> T) -> T {
    let n = x[0].len();
    let mut sums = [T::ZERO; LANES];
    let whole = n / LANES * LANES;
    for at in (0..whole).step_by(LANES) {
        let blocks = x.map(
            #[inline(always)]
            |x| &x[at..at + LANES],
        );
        for l in 0..LANES {
            sums[l] += term(blocks.map(
                #[inline(always)]
                |b| b[l],
            ));
        }
    }
    for i in whole..n {
        sums[i - whole] += term(x.map(|x| x[i]));
    }
    let mut width = LANES / 2;
    while width > 0 {
        for l in 0..width {
            let other = sums[l + width];
            sums[l] += other;
        }
        width /= 2;
    }
    sums[0]
}

/// The sum of all elements on the calling thread alone, for use inside a parallel task.
///
/// ```
/// use weaver_kernels::reduce::sum_serial;
/// assert_eq!(sum_serial(&[1.0, 2.0, 6.0]), 9.0);
/// ```
pub fn sum_serial<T: Real>(x: &[T]) -> T {
    simd::dispatch(
        #[inline(always)]
        || lanes([x], |[x]| x),
    )
}

/// The sum of all elements, in parallel.
///
/// ```
/// use weaver_kernels::reduce::sum;
/// assert_eq!(sum(&[1.0, 2.0, 6.0]), 9.0);
/// ```
pub fn sum<T: Real>(x: &[T]) -> T {
    total(x.len(), |r| sum_serial(&x[r]))
}

/// The mean of all elements; NaN for an empty slice.
///
/// ```
/// use weaver_kernels::reduce::mean;
/// assert_eq!(mean(&[1.0, 2.0, 6.0]), 3.0);
/// ```
pub fn mean<T: Real>(x: &[T]) -> T {
    sum(x) / T::from_usize(x.len())
}

/// The dot product of two slices of equal length, on the calling thread alone.
///
/// ```
/// use weaver_kernels::reduce::dot_serial;
/// assert_eq!(dot_serial(&[1.0, 2.0], &[3.0, 4.0]), 11.0);
/// ```
pub fn dot_serial<T: Real>(x: &[T], y: &[T]) -> T {
    assert_eq!(x.len(), y.len(), "dot: lengths");
    simd::dispatch(
        #[inline(always)]
        || lanes([x, y], |[x, y]| x * y),
    )
}

/// The dot product of two slices of equal length, in parallel.
///
/// ```
/// use weaver_kernels::reduce::dot;
/// assert_eq!(dot(&[1.0, 2.0], &[3.0, 4.0]), 11.0);
/// ```
pub fn dot<T: Real>(x: &[T], y: &[T]) -> T {
    assert_eq!(x.len(), y.len(), "dot: lengths");
    total(x.len(), |r| dot_serial(&x[r.clone()], &y[r]))
}

/// The sum of the squares of all elements.
///
/// ```
/// use weaver_kernels::reduce::squared_norm;
/// assert_eq!(squared_norm(&[3.0, 4.0]), 25.0);
/// ```
pub fn squared_norm<T: Real>(x: &[T]) -> T {
    dot(x, x)
}

/// The sum of every row of `x` `[rows, cols]` into `out` `[rows]`.
///
/// ```
/// use weaver_kernels::reduce::row_sums;
/// let mut out = [0.0; 2];
/// row_sums(2, 2, &[1.0, 2.0, 3.0, 4.0], (&mut out, 0.0));
/// assert_eq!(out, [3.0, 7.0]);
/// ```
#[inline(never)]
pub fn row_sums<T: Real>(rows: usize, cols: usize, x: &[T], out: Target<T>) {
    let (out, beta) = out;
    assert_eq!((x.len(), out.len()), (rows * cols, rows), "row_sums: lengths");
    let grain = (CHUNK / cols.max(1)).max(1);
    for_chunks(out, grain, |chunk, out| {
        for (i, out) in out.iter_mut().enumerate() {
            put(out, beta, sum_serial(&x[(chunk * grain + i) * cols..][..cols]));
        }
    });
}

/// The sum of every column of `x` `[rows, cols]` into `out` `[cols]`.
///
/// Rows are added in order, in blocks of 64, which keeps the rounding error of long columns small.
///
/// ```
/// use weaver_kernels::reduce::column_sums;
/// let mut out = [0.0; 2];
/// column_sums(2, 2, &[1.0, 2.0, 3.0, 4.0], (&mut out, 0.0));
/// assert_eq!(out, [4.0, 6.0]);
/// ```
#[inline(never)]
pub fn column_sums<T: Real>(rows: usize, cols: usize, x: &[T], out: Target<T>) {
    assert_eq!((x.len(), out.0.len()), (rows * cols, cols), "column_sums: lengths");
    column_totals(
        rows,
        out,
        #[inline(always)]
        |row, from, sums| {
            for (sum, x) in sums.iter_mut().zip(&x[row * cols + from..]) {
                *sum += *x;
            }
        },
    );
}

/// Column sums of a matrix that is given by a function: `add(row, from, sums)` adds the elements of `row` from column
/// `from` on to `sums`, as many as there are sums.
#[inline(always)]
pub(crate) fn column_totals<T: Real>(rows: usize, out: Target<T>, add: impl Fn(usize, usize, &mut [T]) + Sync) {
    const BLOCK: usize = 64;
    const WIDTH: usize = 2 * LANES;
    let (out, beta) = out;
    for_chunks(out, WIDTH, |chunk, out| {
        simd::dispatch(
            #[inline(always)]
            || {
                let mut sums = [T::ZERO; WIDTH];
                for block in (0..rows).step_by(BLOCK) {
                    let mut partial = [T::ZERO; WIDTH];
                    for row in block..rows.min(block + BLOCK) {
                        if out.len() == WIDTH {
                            add(row, chunk * WIDTH, &mut partial);
                        } else {
                            add(row, chunk * WIDTH, &mut partial[..out.len()]);
                        }
                    }
                    for l in 0..WIDTH {
                        sums[l] += partial[l];
                    }
                }
                for (out, sum) in out.iter_mut().zip(sums) {
                    put(out, beta, sum);
                }
            },
        );
    });
}
