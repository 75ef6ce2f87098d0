//! Layer normalisation over the last dimension (Ba, Kiros and Hinton 2016).

use crate::parallel::{for_chunks, for_chunks2};
use crate::reduce::{column_totals, lanes};
use crate::target::{Target, put};
use crate::{Real, simd};

/// Rows of one task: about this many elements.
const GRAIN: usize = 1 << 13;

fn rows_per_task(cols: usize) -> usize {
    (GRAIN / cols.max(1)).max(1)
}

/// y = (x - mean) / sqrt(variance + eps) * w + b, row by row, with the population variance.
///
/// `x` and `y` are `[rows, cols]`, `affine` the weights and biases `[cols]`, or `None` for neither.
/// `stats` `[rows, 2]` receives each row's mean and 1 / sqrt(variance + eps), for the gradients.
///
/// ```
/// use weaver_kernels::layer_norm::layer_norm_forward;
/// let (mut y, mut stats) = ([0.0; 2], [0.0; 2]);
/// layer_norm_forward(2, 0.0, &[1.0, 3.0], None, &mut y, &mut stats);
/// assert_eq!((y, stats), ([-1.0, 1.0], [2.0, 1.0]));
/// ```
pub fn layer_norm_forward<T: Real>(
    cols: usize,
    eps: T,
    x: &[T],
    affine: Option<(&[T], &[T])>,
    y: &mut [T],
    stats: &mut [T],
) {
    assert_eq!((x.len(), x.len() * 2), (y.len(), stats.len() * cols), "layer_norm: lengths");
    if let Some((w, b)) = affine {
        assert_eq!((w.len(), b.len()), (cols, cols), "layer_norm: weight and bias lengths");
    }
    let rows = rows_per_task(cols);
    for_chunks2(y, rows * cols, stats, rows * 2, |chunk, y, stats| {
        let x = &x[chunk * rows * cols..][..y.len()];
        simd::dispatch(
            #[inline(always)]
            || {
                for ((x, y), stats) in x.chunks_exact(cols).zip(y.chunks_exact_mut(cols)).zip(stats.chunks_exact_mut(2))
                {
                    let n = T::from_usize(cols);
                    let mean = lanes([x], |[x]| x) / n;
                    let variance = lanes([x], |[x]| (x - mean) * (x - mean)) / n;
                    let rstd = T::ONE / (variance + eps).sqrt();
                    stats[0] = mean;
                    stats[1] = rstd;
                    match affine {
                        Some((w, b)) => {
                            for (((y, x), w), b) in y.iter_mut().zip(x).zip(w).zip(b) {
                                *y = (*x - mean) * rstd * *w + *b;
                            }
                        }
                        None => y.iter_mut().zip(x).for_each(|(y, x)| *y = (*x - mean) * rstd),
                    }
                }
            },
        );
    });
}

/// Gradient with respect to the input. `x`, `dy`, `dx` are `[rows, cols]`, `w` `[cols]` unless there is
/// none, `stats` what the forward pass wrote.
pub fn layer_norm_dx<T: Real>(cols: usize, x: &[T], w: Option<&[T]>, stats: &[T], dy: &[T], dx: Target<T>) {
    let (dx, beta) = dx;
    assert_eq!((x.len(), x.len() * 2, x.len()), (dy.len(), stats.len() * cols, dx.len()), "layer_norm: lengths");
    if let Some(w) = w {
        assert_eq!(w.len(), cols, "layer_norm: weight length");
    }
    let rows = rows_per_task(cols);
    for_chunks(dx, rows * cols, |chunk, dx| {
        let from = chunk * rows * cols;
        let (x, dy) = (&x[from..][..dx.len()], &dy[from..][..dx.len()]);
        let stats = &stats[chunk * rows * 2..];
        simd::dispatch(
            #[inline(always)]
            || {
                let inputs = x.chunks_exact(cols).zip(dy.chunks_exact(cols)).zip(stats.chunks_exact(2));
                for (((x, dy), stats), dx) in inputs.zip(dx.chunks_exact_mut(cols)) {
                    match w {
                        Some(w) => row_dx(
                            [x, dy, w],
                            stats,
                            #[inline(always)]
                            |[x, dy, w]| (x, dy * w),
                            dx,
                            beta,
                        ),
                        None => row_dx(
                            [x, dy],
                            stats,
                            #[inline(always)]
                            |[x, dy]| (x, dy),
                            dx,
                            beta,
                        ),
                    }
                }
            },
        );
    });
}

/// One row of dx; `pair` makes x and the gradient of the normalised x from the inputs' elements.
#[inline(always)]
fn row_dx<T: Real, const K: usize>(
    inputs: [&[T]; K],
    stats: &[T],
    pair: impl Fn([T; K]) -> (T, T),
    dx: &mut [T],
    beta: T,
) {
    let (mean, rstd, n) = (stats[0], stats[1], T::from_usize(dx.len()));
    let along_one = lanes(
        inputs,
        #[inline(always)]
        |x| pair(x).1,
    ) / n;
    let along_x = lanes(
        inputs,
        #[inline(always)]
        |x| {
            let (x, g) = pair(x);
            g * ((x - mean) * rstd)
        },
    ) / n;
    let inputs = inputs.map(|x| &x[..dx.len()]);
    for i in 0..dx.len() {
        let (x, g) = pair(inputs.map(
            #[inline(always)]
            |x| x[i],
        ));
        put(&mut dx[i], beta, rstd * (g - along_one - (x - mean) * rstd * along_x));
    }
}

/// Gradient with respect to the weights `[cols]`; rows are added in their order.
pub fn layer_norm_dw<T: Real>(cols: usize, x: &[T], stats: &[T], dy: &[T], dw: Target<T>) {
    assert_eq!((x.len(), x.len() * 2, cols), (dy.len(), stats.len() * cols, dw.0.len()), "layer_norm: lengths");
    column_totals(
        stats.len() / 2,
        dw,
        #[inline(always)]
        |row, from, sums| {
            let (mean, rstd) = (stats[2 * row], stats[2 * row + 1]);
            let at = row * cols + from;
            let (x, dy) = (&x[at..at + sums.len()], &dy[at..at + sums.len()]);
            for ((sum, x), dy) in sums.iter_mut().zip(x).zip(dy) {
                *sum += *dy * ((*x - mean) * rstd);
            }
        },
    );
}

/// Gradient with respect to the biases `[cols]`: the column sums of dy.
pub fn layer_norm_db<T: Real>(cols: usize, dy: &[T], db: Target<T>) {
    crate::reduce::column_sums(dy.len() / cols.max(1), cols, dy, db);
}
