//! Layer normalization over the last dimension (Ba, Kiros and Hinton 2016).

use crate::lanes::rows::{GROUP, rows_of, rows_of_mut, totals};
use crate::lanes::{self, LANES, LaneKernel, LaneMask, Lanes};
use crate::parallel::{for_chunks, for_chunks2};
use crate::target::{Target, put};
use crate::{Real, simd};

/// Approximate number of elements of one task, which takes whole rows.
const GRAIN: usize = 1 << 13;

fn rows_per_task(cols: usize) -> usize {
    (GRAIN / cols.max(1)).max(1)
}

/// Panics unless `x` and `y` consist of whole rows of `cols` elements and `stats` has two numbers per row.
fn check<T>(cols: usize, x: &[T], stats: &[T], y: &[T]) {
    let [whole, odd] = [stats.len() / 2, stats.len() % 2];
    assert_eq!((x.len(), y.len(), odd), (whole * cols, whole * cols, 0), "layer_norm: lengths");
}

/// Layer normalization of every row: y = (x - mean) / sqrt(variance + eps) * w + b, with the population variance.
///
/// `x` and `y` are `[rows, cols]`; `affine` holds the weights w and biases b, `[cols]` each, and `None` leaves both
/// out. `stats` `[rows, 2]` receives the mean and 1 / sqrt(variance + eps) of every row, for [`layer_norm_backward`].
///
/// # Panics
///
/// If a length does not fit.
///
/// ```
/// use weaver_kernels::layer_norm::layer_norm_forward;
/// let (mut y, mut stats) = ([0.0; 2], [0.0; 2]);
/// layer_norm_forward(2, 0.0, &[1.0, 3.0], None, &mut y, &mut stats);
/// assert_eq!((y, stats), ([-1.0, 1.0], [2.0, 1.0]));
/// ```
#[inline(never)]
pub fn layer_norm_forward<T: Real>(
    cols: usize,
    eps: T,
    x: &[T],
    affine: Option<(&[T], &[T])>,
    y: &mut [T],
    stats: &mut [T],
) {
    check(cols, x, stats, y);
    if let Some((w, b)) = affine {
        assert_eq!((w.len(), b.len()), (cols, cols), "layer_norm: weight and bias lengths");
    }
    let rows = rows_per_task(cols);
    for_chunks2(y, rows * cols, stats, rows * 2, |chunk, y, stats| {
        let x = &x[chunk * rows * cols..][..y.len()];
        lanes::run(Forward { cols, eps, x, affine, y, stats });
    });
}

/// Weights and biases, if there are any.
type Affine<'a, T> = Option<(&'a [T], &'a [T])>;

/// The forward pass of some rows.
struct Forward<'a, T> {
    cols: usize,
    eps: T,
    x: &'a [T],
    affine: Affine<'a, T>,
    y: &'a mut [T],
    stats: &'a mut [T],
}

impl<T: Real> LaneKernel<T> for Forward<'_, T> {
    type Output = ();

    #[inline(always)]
    fn run<V: Lanes<Scalar = T>>(self) {
        let Self { cols, eps, x, affine, y, stats } = self;
        let together = stats.len() / (2 * GROUP) * GROUP;
        for row in (0..together).step_by(GROUP) {
            forward::<V, GROUP>(cols, eps, &x[row * cols..], affine, &mut y[row * cols..], &mut stats[2 * row..]);
        }
        for row in together..stats.len() / 2 {
            forward::<V, 1>(cols, eps, &x[row * cols..], affine, &mut y[row * cols..], &mut stats[2 * row..]);
        }
    }
}

/// The forward pass of the first R rows.
#[inline(always)]
#[expect(clippy::needless_range_loop, reason = "R rows in registers go side by side through several arrays")]
fn forward<V: Lanes, const R: usize>(
    cols: usize,
    eps: V::Scalar,
    x: &[V::Scalar],
    affine: Affine<V::Scalar>,
    y: &mut [V::Scalar],
    stats: &mut [V::Scalar],
) {
    let n = V::Scalar::from_usize(cols);
    let whole = cols / LANES;
    let (x, rest) = rows_of::<V, R>(cols, x);
    let mut sums = rest;
    for i in 0..whole {
        for r in 0..R {
            sums[r] = sums[r] + V::load(&x[r][i]);
        }
    }
    let sums = totals(sums);
    let (mut center, mut squares) = ([V::zero(); R], [V::zero(); R]);
    let inside = V::Mask::from_bits((1 << (cols % LANES)) - 1);
    for r in 0..R {
        stats[2 * r] = sums[r] / n;
        center[r] = V::splat(stats[2 * r]);
        let d = (rest[r] - center[r]).only(inside);
        squares[r] = d * d;
    }
    for i in 0..whole {
        for r in 0..R {
            let d = V::load(&x[r][i]) - center[r];
            squares[r] = d.mul_add(d, squares[r]);
        }
    }
    let squares = totals(squares);
    let mut scale = [V::zero(); R];
    for r in 0..R {
        stats[2 * r + 1] = V::Scalar::ONE / (squares[r] / n + eps).sqrt();
        scale[r] = V::splat(stats[2 * r + 1]);
    }
    let y = rows_of_mut::<_, R>(cols, y);
    let (w, last_w) = affine.map_or((&[][..], V::zero()), |(w, _)| lanes::split(w));
    let (b, last_b) = affine.map_or((&[][..], V::zero()), |(_, b)| lanes::split(b));
    for i in 0..whole {
        for r in 0..R {
            let hat = (V::load(&x[r][i]) - center[r]) * scale[r];
            let out = if affine.is_some() { hat.mul_add(V::load(&w[i]), V::load(&b[i])) } else { hat };
            out.store(&mut y[r].0[i]);
        }
    }
    if !cols.is_multiple_of(LANES) {
        for r in 0..R {
            let hat = (rest[r] - center[r]) * scale[r];
            lanes::put(if affine.is_some() { hat.mul_add(last_w, last_b) } else { hat }, y[r].1, 0);
        }
    }
}

/// Rows whose contributions to the gradients of weights and biases are summed together. The sums of such chunks are
/// added in their order.
const CHUNK: usize = 64;

/// Length of the scratch space of [`layer_norm_backward`] for `[rows, cols]`.
pub fn layer_norm_scratch_len(rows: usize, cols: usize) -> usize {
    2 * rows.div_ceil(CHUNK) * cols
}

/// Gradients of [`layer_norm_forward`] with respect to the input, the weights and the biases, each on request, in one
/// pass.
///
/// `x`, `dy` and `dx` are `[rows, cols]`; `dw` and `db` are `[cols]`. `w` holds the weights, if there are any, and
/// `stats` the statistics of the forward pass. `scratch` has [`layer_norm_scratch_len`] elements with any content.
///
/// # Panics
///
/// If a length does not fit.
///
/// ```
/// use weaver_kernels::layer_norm::{layer_norm_backward, layer_norm_scratch_len};
/// let (stats, mut db, mut scratch) = ([2.0, 1.0], [0.0; 2], vec![0.0; layer_norm_scratch_len(1, 2)]);
/// layer_norm_backward(2, &[1.0, 3.0], None, &stats, &[5.0, 7.0], [None, None, Some((&mut db, 0.0))], &mut scratch);
/// assert_eq!(db, [5.0, 7.0]);
/// ```
#[inline(never)]
pub fn layer_norm_backward<T: Real>(
    cols: usize,
    x: &[T],
    w: Option<&[T]>,
    stats: &[T],
    dy: &[T],
    [dx, dw, db]: [Option<Target<T>>; 3],
    scratch: &mut [T],
) {
    check(cols, x, stats, dy);
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
    if !sums {
        return;
    }
    let (total, parts) = scratch.split_at_mut(2 * cols);
    simd::dispatch(
        #[inline(always)]
        || {
            for part in parts.chunks_exact(2 * cols) {
                total.iter_mut().zip(part).for_each(|(sum, part)| *sum += *part);
            }
        },
    );
    let (weights, biases) = total.split_at(cols);
    for (target, sums) in [(dw, weights), (db, biases)] {
        let Some((out, beta)) = target else { continue };
        assert_eq!(out.len(), cols, "layer_norm: weight length");
        out.iter_mut().zip(sums).for_each(|(out, sum)| put(out, beta, *sum));
    }
}

/// The backward pass of some rows. `scratch` receives their contributions to the gradients of weights and biases, or is
/// empty.
struct Backward<'a, T> {
    cols: usize,
    x: &'a [T],
    w: Option<&'a [T]>,
    stats: &'a [T],
    dy: &'a [T],
    dx: Option<(&'a mut [T], T)>,
    scratch: &'a mut [T],
}

impl<T: Real> LaneKernel<T> for Backward<'_, T> {
    type Output = ();

    #[inline(always)]
    fn run<V: Lanes<Scalar = T>>(self) {
        // Each row has two running sums in registers.
        if V::PARTS > 1 { self.in_groups::<V, { GROUP / 2 }>() } else { self.in_groups::<V, GROUP>() }
    }
}

impl<T: Real> Backward<'_, T> {
    /// The backward pass, R rows at a time.
    #[inline(always)]
    fn in_groups<V: Lanes<Scalar = T>, const R: usize>(self) {
        let Self { cols, x, w, stats, dy, mut dx, scratch } = self;
        scratch.fill(T::ZERO);
        let rows = x.len() / cols;
        let together = rows / R * R;
        for row in (0..together).step_by(R) {
            let dx = dx.as_mut().map(|(dx, beta)| (&mut dx[row * cols..], *beta));
            let part = row * cols;
            backward::<V, R>(cols, &x[part..], w, &stats[2 * row..], &dy[part..], dx, scratch);
        }
        for row in together..rows {
            let dx = dx.as_mut().map(|(dx, beta)| (&mut dx[row * cols..], *beta));
            let part = row * cols;
            backward::<V, 1>(cols, &x[part..], w, &stats[2 * row..], &dy[part..], dx, scratch);
        }
    }
}

/// Statistics and running sums of R rows during the backward pass.
struct Slopes<V, const R: usize> {
    mean: [V; R],
    rstd: [V; R],
    /// Sums along each row of the gradient with respect to the normalized value, plain and times that value; later
    /// their means.
    along_one: [V; R],
    along_x: [V; R],
}

impl<V: Lanes, const R: usize> Slopes<V, R> {
    /// Adds one column of vectors to the sums along the rows. Returns the sums down the columns with that column added.
    #[inline(always)]
    fn add(&mut self, x: [V; R], dy: [V; R], w: V, [mut dw, mut db]: [V; 2]) -> [V; 2] {
        for r in 0..R {
            let (hat, g) = ((x[r] - self.mean[r]) * self.rstd[r], dy[r] * w);
            (self.along_one[r], self.along_x[r]) = (self.along_one[r] + g, g.mul_add(hat, self.along_x[r]));
            (dw, db) = (dy[r].mul_add(hat, dw), db + dy[r]);
        }
        [dw, db]
    }

    /// The gradient with respect to the input, plus beta times `old`.
    #[inline(always)]
    fn gradient(&self, r: usize, x: V, dy: V, w: V, old: V, beta: V::Scalar) -> V {
        let hat = (x - self.mean[r]) * self.rstd[r];
        let d = self.rstd[r] * hat.neg_mul_add(self.along_x[r], dy * w - self.along_one[r]);
        // With beta 0, `old` may be anything, NaN included.
        if beta == V::Scalar::ZERO { d } else { V::splat(beta).mul_add(old, d) }
    }
}

/// The backward pass of the first R rows; their contributions to weights and biases are added to `sums`.
#[inline(always)]
fn backward<V: Lanes, const R: usize>(
    cols: usize,
    x: &[V::Scalar],
    w: Option<&[V::Scalar]>,
    stats: &[V::Scalar],
    dy: &[V::Scalar],
    dx: Option<(&mut [V::Scalar], V::Scalar)>,
    sums: &mut [V::Scalar],
) {
    let (whole, ragged) = (cols / LANES, !cols.is_multiple_of(LANES));
    let ((x, last_x), (dy, last_dy)) = (rows_of::<V, R>(cols, x), rows_of::<V, R>(cols, dy));
    let (w, last_w) = w.map_or((&[][..], V::constant(1.0)), |w| lanes::split(w));
    let weights = |i: usize| w.get(i).map_or(V::constant(1.0), |w| V::load(w));
    let zeros = [V::zero(); R];
    let mut slopes = Slopes { mean: zeros, rstd: zeros, along_one: zeros, along_x: zeros };
    for r in 0..R {
        (slopes.mean[r], slopes.rstd[r]) = (V::splat(stats[2 * r]), V::splat(stats[2 * r + 1]));
    }
    let (dw, db) = sums.split_at_mut(sums.len() / 2);
    let ((dw, last_dw), (db, last_db)) = (dw.as_chunks_mut::<LANES>(), db.as_chunks_mut::<LANES>());
    for i in 0..whole {
        let (mut xs, mut dys) = (zeros, zeros);
        for r in 0..R {
            (xs[r], dys[r]) = (V::load(&x[r][i]), V::load(&dy[r][i]));
        }
        if let (Some(dw), Some(db)) = (dw.get_mut(i), db.get_mut(i)) {
            let down = slopes.add(xs, dys, weights(i), [V::load(dw), V::load(db)]);
            down[0].store(dw);
            down[1].store(db);
        } else {
            slopes.add(xs, dys, weights(i), [V::zero(); 2]);
        }
    }
    if ragged {
        // Beyond the end of the row, dy is 0.
        let down = slopes.add(last_x, last_dy, last_w, [lanes::at(last_dw, 0), lanes::at(last_db, 0)]);
        lanes::put(down[0], last_dw, 0);
        lanes::put(down[1], last_db, 0);
    }
    let Some((dx, beta)) = dx else { return };
    let n = V::Scalar::from_usize(cols);
    let (one, along) = (totals(slopes.along_one), totals(slopes.along_x));
    for r in 0..R {
        (slopes.along_one[r], slopes.along_x[r]) = (V::splat(one[r] / n), V::splat(along[r] / n));
    }
    let dx = rows_of_mut::<_, R>(cols, dx);
    for i in 0..whole {
        for r in 0..R {
            let to = &mut dx[r].0[i];
            slopes.gradient(r, V::load(&x[r][i]), V::load(&dy[r][i]), weights(i), V::load(to), beta).store(to);
        }
    }
    if ragged {
        for r in 0..R {
            let to = &mut *dx[r].1;
            lanes::put(slopes.gradient(r, last_x[r], last_dy[r], last_w, lanes::at(to, 0), beta), to, 0);
        }
    }
}
