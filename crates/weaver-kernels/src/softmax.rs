//! Softmax over one dimension.

use crate::parallel::for_chunks;
use crate::reduce::lanes;
use crate::target::{Target, put};
use crate::{Real, simd};

/// About this many elements make a task.
const GRAIN: usize = 1 << 12;
/// Columns handled together when the dimension is not the last.
const WIDTH: usize = 16;

/// y = e^x / sum e^x over the middle dimension of `[outer, len, inner]`, shifted by the maximum so that
/// nothing overflows. For the last dimension, `inner` is 1.
///
/// ```
/// use weaver_kernels::softmax::softmax_forward;
/// let mut y = [0.0_f64; 2];
/// softmax_forward(2, 1, &[0.0, 3.0_f64.ln()], &mut y);
/// assert!((y[0] - 0.25).abs() < 1e-15 && (y[1] - 0.75).abs() < 1e-15);
/// ```
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
        simd::dispatch(
            #[inline(always)]
            || {
                for (x, y) in x.chunks_exact(block).zip(y.chunks_exact_mut(block)) {
                    if inner == 1 {
                        row(x, y);
                    } else {
                        columns(inner, x, y);
                    }
                }
            },
        );
    });
}

#[inline(always)]
fn row<T: Real>(x: &[T], y: &mut [T]) {
    let top = maximum(x);
    for (y, x) in y.iter_mut().zip(x) {
        *y = (*x - top).exp();
    }
    let scale = T::ONE / lanes([&*y], |[y]| y);
    y.iter_mut().for_each(|y| *y *= scale);
}

/// The largest element; minus infinity if there is none.
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

/// Several columns at a time, so that the loops vectorise across them.
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

/// Gradient, dx = y (dy - sum dy y), from the result `y`; all `[outer, len, inner]`.
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
                        let along = lanes([y, dy], |[y, dy]| y * dy);
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
