//! Structural similarity as a differentiable op.

use super::masked::inside_of;
use crate::ssim_window::{Covariance, Kept, WINDOW, Windows};
use weaver_autograd::{Backward, Op, Pool, Real, Shape, ShapeError, Shapes, Var, View, ViewMut, ensure_shape, ops};
use weaver_kernels::parallel;

/// Planes worked on together, which bounds the scratch memory for any batch and number of threads.
const PLANES_AT_ONCE: usize = 8;

#[derive(Debug)]
struct Ssim<T> {
    covariance: Covariance,
    /// The windows of each image that count; empty if all do.
    kept: Vec<Kept<T>>,
}

impl<T: Real> Ssim<T> {
    fn windows(&self, shape: Shape) -> Windows<T> {
        Windows::new([shape[2], shape[3]], self.covariance)
    }

    /// Runs `body(plane, result, workspace)` on every plane; `done(first plane, results)` takes a group's results.
    fn for_planes(
        &self,
        shape: Shape,
        result_len: usize,
        pool: &Pool,
        body: impl Fn(usize, &mut [T], &mut [T]) + Sync,
        mut done: impl FnMut(usize, &[T]),
    ) {
        let (planes, workspace_len) = (shape[0] * shape[1], self.windows(shape).workspace_len());
        let each = result_len + workspace_len;
        let mut scratch = pool.buffer::<T>(planes.min(PLANES_AT_ONCE) * each);
        for first in (0..planes).step_by(PLANES_AT_ONCE) {
            let count = (planes - first).min(PLANES_AT_ONCE);
            parallel::for_chunks(&mut scratch[..count * each], each, |i, scratch| {
                let (result, workspace) = scratch.split_at_mut(result_len);
                body(first + i, result, workspace);
            });
            for (i, scratch) in scratch[..count * each].chunks(each).enumerate() {
                done(first + i, &scratch[..result_len]);
            }
        }
    }
}

impl<T: Real> Op<T> for Ssim<T> {
    fn name(&self) -> &'static str {
        "ssim"
    }
    fn shapes(&self, ins: &[Shape]) -> Result<Shapes, ShapeError> {
        let images = |s: &Shape| s.rank() == 4 && s[1] > 0 && s[2] >= WINDOW && s[3] >= WINDOW;
        ensure_shape!(
            ins.len() == 2 && ins[0] == ins[1] && images(&ins[0]),
            "two batches of images [N, C, H, W] of one shape, at least {WINDOW} x {WINDOW}"
        );
        Ok(Shapes::one([ins[0][0]]))
    }
    fn forward(&mut self, ins: &[View<'_, T>], outs: &mut [ViewMut<'_, T>], pool: &Pool) {
        let shape = ins[0].shape();
        let (windows, pixels, channels) = (self.windows(shape), shape[2] * shape[3], shape[1]);
        let plane = |of: usize, i: usize| &ins[of][i * pixels..(i + 1) * pixels];
        outs[0].fill(T::ZERO);
        self.for_planes(
            shape,
            1,
            pool,
            |i, result, workspace| {
                let kept = self.kept.get(i / channels);
                result[0] =
                    T::from_f64(windows.similarity(plane(0, i), plane(1, i), kept, workspace) / channels as f64);
            },
            |i, result| outs[0][i / channels] += result[0],
        );
    }
    fn backward(&self, at: Backward<'_, '_, T>) {
        let Backward { ins, douts, dins, pool, .. } = at;
        let shape = ins[0].shape();
        let (windows, pixels, channels) = (self.windows(shape), shape[2] * shape[3], shape[1]);
        let plane = |of: usize, i: usize| &ins[of][i * pixels..(i + 1) * pixels];
        for (of, dx) in dins.iter_mut().enumerate() {
            let Some(dx) = dx else { continue };
            let (dx, beta) = dx.target();
            self.for_planes(
                shape,
                pixels,
                pool,
                |i, result, workspace| {
                    let scale = douts[0][i / channels] / T::from_usize(channels);
                    let kept = self.kept.get(i / channels);
                    windows.gradient([plane(of, i), plane(1 - of, i)], kept, scale, result, workspace);
                },
                |i, result| {
                    let dx = &mut dx[i * pixels..(i + 1) * pixels];
                    if beta == T::ZERO {
                        dx.copy_from_slice(result);
                    } else {
                        dx.iter_mut().zip(result).for_each(|(dx, r)| *dx += *r);
                    }
                },
            );
        }
    }
}

/// The structural similarity (SSIM) of each pair of images: 1 for equal ones.
///
/// It is the mean, over channels and over all 11x11 Gaussian windows (sigma 1.5) inside the image, of `(2 ma mb +
/// C1) (2 cab + C2) / ((ma^2 + mb^2 + C1) (va + vb + C2))`, C1 = 1e-4, C2 = 9e-4, with population variances. `a` and
/// `b` `[N, C, H, W]` in [0, 1] give `[N]`; differentiable in both. Panics unless the shapes are equal and at least
/// 11 x 11. The usual loss is `(1 - ssim) / 2`. Source: Wang et al., Image quality assessment, 2004.
///
/// ```
/// use weaver_autograd::Tape;
/// let tape = Tape::<f64>::new();
/// let image = tape.constant_with([1, 3, 12, 12], |x| (0..432).for_each(|i| x[i] = i as f64 / 432.0));
/// assert!((weaver_losses::ssim(image, image).item() - 1.0).abs() < 1e-12);
/// ```
#[track_caller]
pub fn ssim<'t, T: Real>(a: Var<'t, T>, b: Var<'t, T>) -> Var<'t, T> {
    ssim_with(a, b, Covariance::Population)
}

/// The structural similarity of each pair of images, as [`ssim`], with a choice of how variances are normalized.
#[track_caller]
pub fn ssim_with<'t, T: Real>(a: Var<'t, T>, b: Var<'t, T>, covariance: Covariance) -> Var<'t, T> {
    let [similarity] = a.tape().apply(Ssim { covariance, kept: Vec::new() }, &[a, b]);
    similarity
}

/// The structural similarity of each pair of images over windows around every pixel, with zeros outside the images, as
/// most training code of Gaussians has it; otherwise as [`ssim`].
///
/// ```
/// use weaver_autograd::Tape;
/// let tape = Tape::<f64>::new();
/// let image = tape.constant(&[0.5; 12], [1, 3, 2, 2]);
/// assert!((weaver_losses::ssim_zero_padded(image, image).item() - 1.0).abs() < 1e-12);
/// ```
#[track_caller]
pub fn ssim_zero_padded<'t, T: Real>(a: Var<'t, T>, b: Var<'t, T>) -> Var<'t, T> {
    let [a, b] = [a, b].map(|image| padded(padded(image, 2), 3));
    ssim(a, b)
}

/// Zeros before and after, half a window each.
fn padded<T: Real>(x: Var<'_, T>, axis: usize) -> Var<'_, T> {
    let shape = x.shape();
    let sides = [0, 1, 2, 3].map(|i| if i == axis { WINDOW / 2 } else { shape[i] });
    let zeros = x.tape().constant_with(sides, |all| all.fill(T::ZERO));
    ops::concat(&[zeros, x, zeros], axis)
}

/// The structural similarity of each pair of images over the windows all of whose pixels are in a mask, as [`ssim`].
///
/// `a` and `b` `[N, C, H, W]` with a mask `inside` `[N, H, W]` give `[N]`: 1 where no window is whole. Differentiable
/// in both; pixels outside have no influence and no gradient, NaN included. Panics as [`ssim`], and unless the mask has
/// a value for each pixel.
///
/// ```
/// use weaver_autograd::Tape;
/// let tape = Tape::<f64>::new();
/// let mut hidden = vec![0.3; 3 * 144];
/// let truth = tape.constant(&hidden, [1, 3, 12, 12]);
/// hidden[0] = f64::NAN;
/// let mut inside = vec![true; 144];
/// inside[0] = false;
/// assert_eq!(weaver_losses::masked_ssim(tape.constant(&hidden, [1, 3, 12, 12]), truth, &inside).item(), 1.0);
/// ```
#[track_caller]
pub fn masked_ssim<'t, T: Real>(a: Var<'t, T>, b: Var<'t, T>, inside: &[bool]) -> Var<'t, T> {
    let size = [a.shape()[2], a.shape()[3]];
    assert!(size.iter().all(|side| *side >= WINDOW), "masked_ssim: images of at least {WINDOW} x {WINDOW}");
    let [a, b] = [a, b].map(|image| inside_of(image, inside));
    let kept = inside.chunks(size[0] * size[1]).map(|mask| Kept::whole(mask, size)).collect();
    let [similarity] = a.tape().apply(Ssim { covariance: Covariance::Population, kept }, &[a, b]);
    similarity
}
