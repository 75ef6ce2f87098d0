//! Root-mean-square normalization over the last dimension (Zhang and Sennrich 2019, arXiv 1910.07467).

use crate::parallel::{for_chunks, for_chunks2};
use crate::target::{Target, put};
use crate::{Real, simd};

/// Rows of one task; the sums for the weights' gradient of such chunks are added in their order.
const CHUNK: usize = 256;
/// Partial sums of a row, so that it is summed in vectors, in the same order everywhere.
const LANES: usize = 8;

/// The sum of `of(i)` over `0..count`.
#[inline(always)]
fn sum<T: Real>(count: usize, of: impl Fn(usize) -> T) -> T {
    let mut sums = [T::ZERO; LANES];
    let whole = count / LANES * LANES;
    for first in (0..whole).step_by(LANES) {
        for (lane, sum) in sums.iter_mut().enumerate() {
            *sum += of(first + lane);
        }
    }
    for (sum, i) in sums.iter_mut().zip(whole..count) {
        *sum += of(i);
    }
    sums.into_iter().sum()
}

/// 1 / sqrt(mean of squares + eps)
#[inline(always)]
fn scale<T: Real>(x: &[T], eps: T) -> T {
    T::ONE / (sum(x.len(), |i| x[i] * x[i]) / T::from_usize(x.len()) + eps).sqrt()
}

/// Divides every row by the root of its mean square: y = x / sqrt(mean(x^2) + eps) * w.
///
/// `x` and `y` are `[rows, cols]`, the weights `w` are `[cols]`.
///
/// # Panics
///
/// If a length does not fit.
///
/// ```
/// let mut y = [0.0; 2];
/// weaver_kernels::rms_norm::rms_norm_forward(0.0, &[2.0, -2.0], &[1.0, 3.0], &mut y);
/// assert_eq!(y, [1.0, -3.0]);
/// ```
#[inline(never)]
pub fn rms_norm_forward<T: Real>(eps: T, x: &[T], w: &[T], y: &mut [T]) {
    let cols = w.len();
    assert!(x.len() == y.len() && x.len().is_multiple_of(cols.max(1)), "rms_norm: lengths");
    for_chunks(y, CHUNK * cols.max(1), |chunk, y| {
        let x = &x[chunk * CHUNK * cols..][..y.len()];
        simd::dispatch(
            #[inline(always)]
            || {
                for (x, y) in x.chunks_exact(cols).zip(y.chunks_exact_mut(cols)) {
                    let scale = scale(x, eps);
                    y.iter_mut().zip(x).zip(w).for_each(|((y, x), w)| *y = *x * scale * *w);
                }
            },
        );
    });
}

/// Length of the scratch space of [`rms_norm_backward`] for `[rows, cols]`.
pub fn rms_norm_scratch_len(rows: usize, cols: usize) -> usize {
    rows.div_ceil(CHUNK) * cols
}

/// Gradients of [`rms_norm_forward`] with respect to the input and the weights, each on request.
///
/// With s = 1 / sqrt(mean(x^2) + eps): dx = s (w dy - x s^2 mean(x w dy)), dw = sum over rows of dy x s. `x`, `dy` and
/// `dx` are `[rows, cols]`, `w` and `dw` `[cols]`. `scratch` has [`rms_norm_scratch_len`] elements with any content.
///
/// # Panics
///
/// If a length does not fit.
#[inline(never)]
pub fn rms_norm_backward<T: Real>(
    eps: T,
    x: &[T],
    w: &[T],
    dy: &[T],
    [dx, dw]: [Option<Target<T>>; 2],
    scratch: &mut [T],
) {
    let cols = w.len();
    if cols == 0 {
        return;
    }
    assert!(x.len() == dy.len() && x.len().is_multiple_of(cols), "rms_norm: lengths");
    let scratch = &mut scratch[..rms_norm_scratch_len(x.len() / cols, cols)];
    let part = |chunk: usize| chunk * CHUNK * cols..((chunk + 1) * CHUNK * cols).min(x.len());
    let pass = |chunk: usize, dx: Option<(&mut [T], T)>, sums: &mut [T]| {
        let (x, dy) = (&x[part(chunk)], &dy[part(chunk)]);
        simd::dispatch(
            #[inline(always)]
            || backward(eps, [x, w, dy], dx, sums),
        );
    };
    match dx {
        Some((dx, beta)) => {
            assert_eq!(dx.len(), x.len(), "rms_norm: lengths");
            for_chunks2(dx, CHUNK * cols, scratch, cols, |chunk, dx, sums| pass(chunk, Some((dx, beta)), sums));
        }
        None => for_chunks(scratch, cols, |chunk, sums| pass(chunk, None, sums)),
    }
    if let Some((dw, beta)) = dw {
        for (column, dw) in dw.iter_mut().enumerate() {
            put(dw, beta, scratch.iter().skip(column).step_by(cols).copied().sum());
        }
    }
}

/// Some rows; `sums` receives their part of the weights' gradient.
#[inline(always)]
fn backward<T: Real>(eps: T, [x, w, dy]: [&[T]; 3], mut dx: Option<(&mut [T], T)>, sums: &mut [T]) {
    let cols = w.len();
    sums.fill(T::ZERO);
    for (row, (x, dy)) in x.chunks_exact(cols).zip(dy.chunks_exact(cols)).enumerate() {
        let scale = scale(x, eps);
        sums.iter_mut().zip(x).zip(dy).for_each(|((sum, x), dy)| *sum += *dy * *x * scale);
        if let Some((dx, beta)) = &mut dx {
            let along = scale * scale * sum(cols, |i| x[i] * w[i] * dy[i]) / T::from_usize(cols);
            for (i, dx) in dx[row * cols..(row + 1) * cols].iter_mut().enumerate() {
                put(dx, *beta, scale * (w[i] * dy[i] - x[i] * along));
            }
        }
    }
}
