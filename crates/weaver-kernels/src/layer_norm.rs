//! Layer normalisation over the last dimension (Ba, Kiros and Hinton 2016).

use crate::Real;
use crate::lanes::{self, LANES, LaneKernel, Lanes};
use crate::parallel::{for_chunks, for_chunks2};
use crate::target::{Target, put};

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
        lanes::run(Forward { cols, eps, x, affine, y, stats });
    });
}

/// Some rows of the forward pass.
struct Forward<'a, T> {
    cols: usize,
    eps: T,
    x: &'a [T],
    affine: Option<(&'a [T], &'a [T])>,
    y: &'a mut [T],
    stats: &'a mut [T],
}

/// The sums of the lanes of two vectors.
#[inline(always)]
fn totals<V: Lanes>(a: V, b: V) -> [V::Scalar; 2] {
    let o = V::zero();
    let [a, b, ..] = V::sums(&[a, b, o, o, o, o, o, o, o, o, o, o, o, o, o, o]).to_array();
    [a, b]
}

impl<T: Real> LaneKernel<T> for Forward<'_, T> {
    type Output = ();

    #[inline(always)]
    fn run<V: Lanes<Scalar = T>>(self) {
        let Self { cols, eps, x, affine, y, stats } = self;
        let n = T::from_usize(cols);
        let rows = x.chunks_exact(cols).zip(y.chunks_exact_mut(cols)).zip(stats.chunks_exact_mut(2));
        for ((x, y), stats) in rows {
            let mut sum = V::zero();
            for at in (0..cols).step_by(LANES) {
                sum = sum + lanes::at::<V>(x, at);
            }
            let mean = totals(sum, V::zero())[0] / n;
            let centre = V::splat(mean);
            let mut squares = V::zero();
            for at in (0..cols / LANES * LANES).step_by(LANES) {
                let d = lanes::at::<V>(x, at) - centre;
                squares = d.mul_add(d, squares);
            }
            let mut square = totals(squares, V::zero())[0];
            for x in &x[cols / LANES * LANES..] {
                square += (*x - mean) * (*x - mean);
            }
            let rstd = T::ONE / (square / n + eps).sqrt();
            (stats[0], stats[1]) = (mean, rstd);
            let scale = V::splat(rstd);
            for at in (0..cols).step_by(LANES) {
                let hat = (lanes::at::<V>(x, at) - centre) * scale;
                let out = match affine {
                    Some((w, b)) => hat.mul_add(lanes::at::<V>(w, at), lanes::at::<V>(b, at)),
                    None => hat,
                };
                lanes::put(out, y, at);
            }
        }
    }
}

/// Rows whose gradients of the weights are summed together; the sums of such chunks are added in their order.
const CHUNK: usize = 64;

/// Length of the scratch that [`layer_norm_backward`] wants for `[rows, cols]`.
pub fn layer_norm_scratch_len(rows: usize, cols: usize) -> usize {
    2 * rows.div_ceil(CHUNK) * cols
}

/// Gradients of the input `[rows, cols]`, and of weights and biases `[cols]`, each where it is asked for, in one pass.
///
/// `w` are the weights, unless there are none, `stats` what the forward pass wrote, `scratch` of
/// [`layer_norm_scratch_len`] elements with any content.
pub fn layer_norm_backward<T: Real>(
    cols: usize,
    x: &[T],
    w: Option<&[T]>,
    stats: &[T],
    dy: &[T],
    [dx, dw, db]: [Option<Target<T>>; 3],
    scratch: &mut [T],
) {
    assert_eq!((x.len(), x.len() * 2), (dy.len(), stats.len() * cols), "layer_norm: lengths");
    assert!(w.is_none_or(|w| w.len() == cols), "layer_norm: weight length");
    if cols == 0 {
        return;
    }
    let rows = stats.len() / 2;
    let scratch = &mut scratch[..layer_norm_scratch_len(rows, cols)];
    let chunk = |index: usize| index * CHUNK * cols..((index + 1) * CHUNK * cols).min(x.len());
    let sums = dw.is_some() || db.is_some();
    let pass = |index: usize, dx: Option<(&mut [T], T)>, scratch: &mut [T]| {
        let part = chunk(index);
        let (x, dy) = (&x[part.clone()], &dy[part]);
        let scratch = if sums { scratch } else { &mut [] };
        lanes::run(Backward { cols, x, w, stats: &stats[2 * CHUNK * index..], dy, dx, scratch });
    };
    match dx {
        Some((dx, beta)) => {
            assert_eq!(dx.len(), x.len(), "layer_norm: lengths");
            for_chunks2(dx, CHUNK * cols, scratch, 2 * cols, |index, dx, scratch| {
                pass(index, Some((dx, beta)), scratch)
            });
        }
        None => for_chunks(scratch, 2 * cols, |index, scratch| pass(index, None, scratch)),
    }
    for (target, first) in [(dw, 0), (db, cols)] {
        let Some((out, beta)) = target else { continue };
        assert_eq!(out.len(), cols, "layer_norm: weight length");
        for (i, out) in out.iter_mut().enumerate() {
            let parts = scratch.chunks_exact(2 * cols).map(|part| part[first + i]);
            put(out, beta, parts.fold(T::ZERO, |sum, part| sum + part));
        }
    }
}

/// Some rows of the backward pass; `scratch` gets their sums for weights and biases, or is empty.
struct Backward<'a, T> {
    cols: usize,
    x: &'a [T],
    w: Option<&'a [T]>,
    stats: &'a [T],
    dy: &'a [T],
    dx: Option<(&'a mut [T], T)>,
    scratch: &'a mut [T],
}

/// dy, times the weights if there are any.
#[inline(always)]
fn scaled<V: Lanes>(dy: V, w: Option<&[V::Scalar]>, at: usize) -> V {
    match w {
        Some(w) => dy * lanes::at::<V>(w, at),
        None => dy,
    }
}

impl<T: Real> LaneKernel<T> for Backward<'_, T> {
    type Output = ();

    #[inline(always)]
    fn run<V: Lanes<Scalar = T>>(self) {
        let Self { cols, x, w, stats, dy, mut dx, scratch } = self;
        scratch.fill(T::ZERO);
        let (dw, db) = scratch.split_at_mut(scratch.len() / 2);
        let n = T::from_usize(cols);
        for (row, (x, dy)) in x.chunks_exact(cols).zip(dy.chunks_exact(cols)).enumerate() {
            let (mean, rstd) = (V::splat(stats[2 * row]), V::splat(stats[2 * row + 1]));
            let (mut along_one, mut along_x) = (V::zero(), V::zero());
            for at in (0..cols).step_by(LANES) {
                let (hat, dy) = ((lanes::at::<V>(x, at) - mean) * rstd, lanes::at::<V>(dy, at));
                // Beyond the row, dy is 0.
                let g = scaled(dy, w, at);
                (along_one, along_x) = (along_one + g, g.mul_add(hat, along_x));
                if !dw.is_empty() {
                    lanes::put(dy.mul_add(hat, lanes::at::<V>(dw, at)), dw, at);
                    lanes::put(dy + lanes::at::<V>(db, at), db, at);
                }
            }
            if let Some((dx, beta)) = &mut dx {
                let dx = &mut dx[row * cols..][..cols];
                let [one, x_] = totals(along_one, along_x);
                let (along_one, along_x) = (V::splat(one / n), V::splat(x_ / n));
                for at in (0..cols).step_by(LANES) {
                    let (hat, dy) = ((lanes::at::<V>(x, at) - mean) * rstd, lanes::at::<V>(dy, at));
                    let g = scaled(dy, w, at);
                    let mut d = rstd * (g - along_one - hat * along_x);
                    if *beta != T::ZERO {
                        d = V::splat(*beta).mul_add(lanes::at::<V>(dx, at), d);
                    }
                    lanes::put(d, dx, at);
                }
            }
        }
    }
}
