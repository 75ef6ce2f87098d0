//! Softmax over one dimension.

use crate::lanes::rows::totals;
use crate::lanes::{self, LANES, LaneKernel, LaneMask, Lanes};
use crate::parallel::for_chunks;
use crate::target::{Target, put};
use crate::{Real, reduce, simd};

/// Approximate number of elements of one task.
const GRAIN: usize = 1 << 12;
/// Columns that are handled together when the dimension is not the last.
const WIDTH: usize = 16;

/// Softmax over the middle dimension of `[outer, len, inner]`: y = e^x / sum e^x.
///
/// For the last dimension of a tensor, `inner` is 1. The maximum is subtracted first, so that nothing overflows.
///
/// # Panics
///
/// If a length does not fit.
///
/// ```
/// use weaver_kernels::softmax::softmax_forward;
/// let mut y = [0.0_f64; 2];
/// softmax_forward(2, 1, &[0.0, 3.0_f64.ln()], &mut y);
/// assert!((y[0] - 0.25).abs() < 1e-15 && (y[1] - 0.75).abs() < 1e-15);
/// ```
#[inline(never)]
pub fn softmax_forward<T: Real>(len: usize, inner: usize, x: &[T], y: &mut [T]) {
    assert_eq!(x.len(), y.len(), "softmax: lengths");
    let block = len * inner;
    if block == 0 {
        return;
    }
    assert_eq!(x.len() % block, 0, "softmax: length");
    let grain = GRAIN.div_ceil(block) * block;
    for_chunks(y, grain, |chunk, y| {
        let x = &x[chunk * grain..][..y.len()];
        if inner == 1 && len >= LANES {
            return lanes::run(Forward { len, x, y });
        }
        simd::dispatch(
            #[inline(always)]
            || {
                for (x, y) in x.chunks_exact(block).zip(y.chunks_exact_mut(block)) {
                    if inner == 1 {
                        short_row(x, y);
                    } else {
                        columns(inner, x, y);
                    }
                }
            },
        );
    });
}

/// Softmax of rows that are at least one vector long.
struct Forward<'a, T> {
    len: usize,
    x: &'a [T],
    y: &'a mut [T],
}

impl<T: Real> LaneKernel<T> for Forward<'_, T> {
    type Output = ();

    #[inline(always)]
    fn run<V: Lanes<Scalar = T>>(self) {
        for (x, y) in self.x.chunks_exact(self.len).zip(self.y.chunks_exact_mut(self.len)) {
            long_row::<V>(x, y);
        }
    }
}

#[inline(always)]
fn long_row<V: Lanes>(x: &[V::Scalar], y: &mut [V::Scalar]) {
    let top = V::splat(maximum(x));
    let (x, last) = lanes::split::<V>(x);
    let (y, end) = y.as_chunks_mut::<LANES>();
    // Four independent sums hide the latency of additions.
    let mut sums = [V::zero(); 4];
    for (i, (x, y)) in x.iter().zip(&mut *y).enumerate() {
        let e = (V::load(x) - top).exp();
        e.store(y);
        sums[i % 4] = sums[i % 4] + e;
    }
    let last = (last - top).exp().only(V::Mask::from_bits((1 << end.len()) - 1));
    let [sum] = totals([(sums[0] + sums[1]) + (sums[2] + sums[3]) + last]);
    let scale = V::splat(V::Scalar::ONE / sum);
    for y in y {
        (V::load(y) * scale).store(y);
    }
    lanes::put(last * scale, end, 0);
}

/// Softmax of a row that is shorter than a vector.
#[inline(always)]
fn short_row<T: Real>(x: &[T], y: &mut [T]) {
    let top = maximum(x);
    for (y, x) in y.iter_mut().zip(x) {
        *y = (*x - top).exp();
    }
    let scale = T::ONE / reduce::lanes([&*y], |[y]| y);
    y.iter_mut().for_each(|y| *y *= scale);
}

/// The largest element; minus infinity for an empty slice.
#[inline(always)]
pub(crate) fn maximum<T: Real>(x: &[T]) -> T {
    let mut tops = [-T::INFINITY; WIDTH];
    let (blocks, rest) = x.as_chunks::<WIDTH>();
    for block in blocks {
        for l in 0..WIDTH {
            tops[l] = if block[l] > tops[l] { block[l] } else { tops[l] };
        }
    }
    rest.iter().chain(&tops).fold(-T::INFINITY, |a, b| if *b > a { *b } else { a })
}

/// Softmax down the columns, several at a time so that the loops vectorize across them.
#[inline(always)]
fn columns<T: Real>(inner: usize, x: &[T], y: &mut [T]) {
    for from in (0..inner).step_by(WIDTH) {
        let width = WIDTH.min(inner - from);
        let mut tops = [-T::INFINITY; WIDTH];
        for x in x.chunks_exact(inner) {
            for (top, x) in tops.iter_mut().zip(&x[from..from + width]) {
                *top = if *x > *top { *x } else { *top };
            }
        }
        let mut sums = [T::ZERO; WIDTH];
        for (x, y) in x.chunks_exact(inner).zip(y.chunks_exact_mut(inner)) {
            let (x, y) = (&x[from..from + width], &mut y[from..from + width]);
            for (((x, y), top), sum) in x.iter().zip(y).zip(&tops).zip(&mut sums) {
                *y = (*x - *top).exp();
                *sum += *y;
            }
        }
        for y in y.chunks_exact_mut(inner) {
            for (y, sum) in y[from..from + width].iter_mut().zip(&sums) {
                *y /= *sum;
            }
        }
    }
}

/// Gradient of [`softmax_forward`] with respect to its input, from its result `y`: dx = y (dy - sum dy y).
///
/// All slices are `[outer, len, inner]`.
///
/// # Panics
///
/// If a length does not fit.
#[inline(never)]
pub fn softmax_backward<T: Real>(len: usize, inner: usize, y: &[T], dy: &[T], dx: Target<T>) {
    let (dx, beta) = dx;
    assert_eq!((y.len(), y.len()), (dy.len(), dx.len()), "softmax: lengths");
    let block = len * inner;
    if block == 0 {
        return;
    }
    assert_eq!(y.len() % block, 0, "softmax: length");
    let grain = GRAIN.div_ceil(block) * block;
    for_chunks(dx, grain, |chunk, dx| {
        let from = chunk * grain;
        let (y, dy) = (&y[from..][..dx.len()], &dy[from..][..dx.len()]);
        simd::dispatch(
            #[inline(always)]
            || {
                let blocks = y.chunks_exact(block).zip(dy.chunks_exact(block)).zip(dx.chunks_exact_mut(block));
                for ((y, dy), dx) in blocks {
                    if inner == 1 {
                        let along = reduce::lanes([y, dy], |[y, dy]| y * dy);
                        for ((dx, y), dy) in dx.iter_mut().zip(y).zip(dy) {
                            put(dx, beta, *y * (*dy - along));
                        }
                    } else {
                        columns_backward(inner, y, dy, dx, beta);
                    }
                }
            },
        );
    });
}

#[inline(always)]
fn columns_backward<T: Real>(inner: usize, y: &[T], dy: &[T], dx: &mut [T], beta: T) {
    for from in (0..inner).step_by(WIDTH) {
        let to = inner.min(from + WIDTH);
        let mut along = [T::ZERO; WIDTH];
        for (y, dy) in y.chunks_exact(inner).zip(dy.chunks_exact(inner)) {
            for ((along, y), dy) in along.iter_mut().zip(&y[from..to]).zip(&dy[from..to]) {
                *along += *y * *dy;
            }
        }
        for ((y, dy), dx) in y.chunks_exact(inner).zip(dy.chunks_exact(inner)).zip(dx.chunks_exact_mut(inner)) {
            let terms = y[from..to].iter().zip(&dy[from..to]).zip(&along);
            for (((y, dy), along), dx) in terms.zip(&mut dx[from..to]) {
                put(dx, beta, *y * (*dy - *along));
            }
        }
    }
}
