//! Two-dimensional convolution and transposed convolution of `[N, C, H, W]` maps with zero padding.
//!
//! As usual in neural networks, convolution means cross-correlation: the kernel is not flipped. It is computed as the
//! product of the weights with the matrix of all windows of the input (im2col), but that matrix is never stored: at
//! stride 1 the tiles of [`gemm`](crate::gemm) read the windows from the padded input, otherwise windows are written
//! into the panels that the product packs.

use crate::Real;
use crate::extent::product;
use crate::gemm::{Mat, MatMut, Product, gemm_batched};
use crate::parallel::for_chunks;
use crate::target::{Target, put};

mod direct;
mod transposed;
mod windows;

pub use transposed::{
    conv_transpose2d_dw, conv_transpose2d_dx, conv_transpose2d_forward, conv_transpose2d_scratch_len,
};
use windows::{WindowRows, Windows};

/// The sizes of a convolution from `[n, c, h, w]` to `[n, o, out_h(), out_w()]` with weights `[o, c, kh, kw]`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Conv2dShape {
    /// Number of images.
    pub n: usize,
    /// Number of input channels.
    pub c: usize,
    /// Input height.
    pub h: usize,
    /// Input width.
    pub w: usize,
    /// Number of output channels.
    pub o: usize,
    /// Kernel height.
    pub kh: usize,
    /// Kernel width.
    pub kw: usize,
    /// Step between neighboring windows, vertically and horizontally.
    pub stride: usize,
    /// Rows and columns of zeros added on each of the four sides.
    pub pad: usize,
}

impl Conv2dShape {
    /// Output height; 0 if the kernel does not fit.
    pub fn out_h(&self) -> usize {
        self.outputs(self.h, self.kh)
    }

    /// Output width; 0 if the kernel does not fit.
    pub fn out_w(&self) -> usize {
        self.outputs(self.w, self.kw)
    }

    fn outputs(&self, len: usize, kernel: usize) -> usize {
        let padded = len.saturating_add(self.pad.saturating_mul(2));
        padded.saturating_add(self.stride).saturating_sub(kernel) / self.stride
    }

    /// Number of elements of a window, which is the number of rows of the window matrix.
    fn depth(&self) -> usize {
        self.c * self.kh * self.kw
    }

    fn pixels(&self) -> usize {
        self.out_h() * self.out_w()
    }

    fn check(&self, x: usize, w: usize, y: usize) {
        let Self { n, c, h, w: width, o, kh, kw, stride, .. } = *self;
        assert!(kh > 0 && kw > 0 && stride > 0, "conv2d: kernel and stride of {self:?} must not be 0");
        assert_eq!(Some(x), product([n, c, h, width]), "conv2d: input length of {self:?}");
        assert_eq!(Some(w), product([o, c, kh, kw]), "conv2d: weight length of {self:?}");
        assert_eq!(Some(y), product([n, o, self.out_h(), self.out_w()]), "conv2d: output length of {self:?}");
    }

    fn windows<'a, T>(&self, x: &'a [T]) -> Windows<'a, T> {
        let pads = [self.pad as isize; 2];
        // For a 1 x 1 kernel, an image is one long row.
        if [self.kh, self.kw, self.stride, self.pad] == [1, 1, 1, 0] {
            let pixels = self.h * self.w;
            return Windows { x, c: self.c, h: 1, w: pixels, kh: 1, kw: 1, stride: 1, pads, out_w: pixels };
        }
        let Self { c, h, w, kh, kw, stride, .. } = *self;
        Windows { x, c, h, w, kh, kw, stride, pads, out_w: self.out_w() }
    }
}

/// Convolution with an optional bias.
///
/// `y[n, o, i, j] = b[o] + sum over c, p, q of w[o, c, p, q] x[n, c, i stride + p - pad, j stride + q - pad]`
///
/// `x` is `[n, c, h, w]`, `w` `[o, c, kh, kw]`, `b` `[o]`, `y` `[n, o, out_h, out_w]`.
///
/// # Panics
///
/// If a length does not fit the shape.
///
/// ```
/// use weaver_kernels::conv::{Conv2dShape, conv2d_forward};
/// let shape = Conv2dShape { n: 1, c: 1, h: 1, w: 3, o: 1, kh: 1, kw: 3, stride: 1, pad: 0 };
/// let mut y = [0.0];
/// conv2d_forward(&shape, &[1.0, 2.0, 3.0], &[1.0, 10.0, 100.0], Some(&[0.5]), &mut y);
/// assert_eq!(y, [321.5]);
/// ```
#[inline(never)]
pub fn conv2d_forward<T: Real>(shape: &Conv2dShape, x: &[T], w: &[T], b: Option<&[T]>, y: &mut [T]) {
    let beta = match b {
        Some(b) => {
            assert_eq!(b.len(), shape.o, "conv2d: bias length of {shape:?}");
            for_chunks(y, shape.pixels(), |plane, y| y.fill(b[plane % shape.o]));
            T::ONE
        }
        None => T::ZERO,
    };
    correlate(shape, x, w, (y, beta));
}

/// y = beta y + w * x.
fn correlate<T: Real>(shape: &Conv2dShape, x: &[T], w: &[T], y: Target<T>) {
    let (y, beta) = y;
    shape.check(x.len(), w.len(), y.len());
    let (depth, pixels) = (shape.depth(), shape.pixels());
    let windows = shape.windows(x);
    if direct::suits(&windows) {
        return direct::forward(&windows, [shape.n, shape.o, shape.out_h()], w, y, beta);
    }
    let (w, y) = (Mat::new(w, shape.o, depth), MatMut::new(y, shape.o, pixels));
    let product = Product { alpha: T::ONE, a: w.batch(0), b: &windows, beta, pairs: false };
    product.run(shape.n, y.batch(shape.o * pixels), true);
}

/// Length of the scratch space of [`conv2d_dx`].
pub fn conv2d_dx_scratch_len(shape: &Conv2dShape) -> usize {
    if shape.stride == 1 { shape.o * shape.depth() } else { shape.n * shape.depth() * shape.pixels() }
}

/// Gradient of [`conv2d_forward`] with respect to the input.
///
/// `w` is `[o, c, kh, kw]`, `dy` `[n, o, out_h, out_w]`, `dx` `[n, c, h, w]`; `scratch` has [`conv2d_dx_scratch_len`]
/// elements with any content.
///
/// # Panics
///
/// If a length does not fit the shape.
#[inline(never)]
pub fn conv2d_dx<T: Real>(shape: &Conv2dShape, w: &[T], dy: &[T], dx: Target<T>, scratch: &mut [T]) {
    let (dx, beta) = dx;
    shape.check(dx.len(), w.len(), dy.len());
    let Conv2dShape { n, c, h, w: width, o, kh, kw, pad, .. } = *shape;
    let scratch = &mut scratch[..conv2d_dx_scratch_len(shape)];
    if shape.stride > 1 {
        let (depth, pixels) = (shape.depth(), shape.pixels());
        let (w, dy) = (Mat::new(w, o, depth).transposed(), Mat::new(dy, o, pixels));
        let windows = MatMut::new(scratch, depth, pixels).batch(depth * pixels);
        gemm_batched(n, T::ONE, w.batch(0), dy.batch(o * pixels), T::ZERO, windows);
        return gather_windows(shape, scratch, dx, beta);
    }
    // At stride 1 this is a convolution of dy with the kernel rotated by 180 degrees.
    let taps = kh * kw;
    for_chunks(scratch, o * taps, |c, turned| {
        for (o, turned) in turned.chunks_exact_mut(taps).enumerate() {
            let kernel = &w[(o * shape.c + c) * taps..][..taps];
            turned.iter_mut().zip(kernel.iter().rev()).for_each(|(t, w)| *t = *w);
        }
    });
    let windows = Windows {
        x: dy,
        c: o,
        h: shape.out_h(),
        w: shape.out_w(),
        kh,
        kw,
        stride: 1,
        pads: [kh, kw].map(|k| k as isize - 1 - pad as isize),
        out_w: width,
    };
    if direct::suits(&windows) {
        return direct::forward(&windows, [n, c, h], scratch, dx, beta);
    }
    let (turned, dx) = (Mat::new(scratch, c, o * taps), MatMut::new(dx, c, h * width));
    let product = Product { alpha: T::ONE, a: turned.batch(0), b: &windows, beta, pairs: false };
    product.run(n, dx.batch(c * h * width), true);
}

/// The adjoint of taking windows (col2im): `dx[n, c, y, x]` is the sum of the window elements that pixel (y, x) went
/// into. `windows` is `[n, c kh kw, out_h out_w]`.
fn gather_windows<T: Real>(shape: &Conv2dShape, windows: &[T], dx: &mut [T], beta: T) {
    let Conv2dShape { h, w, kh, kw, stride, pad, .. } = *shape;
    let (out_h, out_w) = (shape.out_h(), shape.out_w());
    // The window whose element k is at padded position `at`, if there is one.
    let window = |at: usize, k: usize, count: usize| {
        let from = at.checked_sub(k)?;
        (from % stride == 0 && from / stride < count).then_some(from / stride)
    };
    for_chunks(dx, h * w, |plane, dx| {
        let windows = &windows[plane * kh * kw * out_h * out_w..][..kh * kw * out_h * out_w];
        for y in 0..h {
            for x in 0..w {
                let mut sum = T::ZERO;
                for p in 0..kh {
                    let Some(i) = window(y + pad, p, out_h) else { continue };
                    for q in 0..kw {
                        if let Some(j) = window(x + pad, q, out_w) {
                            sum += windows[((p * kw + q) * out_h + i) * out_w + j];
                        }
                    }
                }
                put(&mut dx[y * w + x], beta, sum);
            }
        }
    });
}

/// Length of the scratch space of [`conv2d_dw`].
pub fn conv2d_dw_scratch_len<T: Real>(shape: &Conv2dShape) -> usize {
    let windows = shape.windows::<T>(&[]);
    if direct::suits(&windows) { direct::weights_scratch_len(&windows, shape.o, shape.out_h()) } else { 0 }
}

/// Gradient of [`conv2d_forward`] with respect to the weights.
///
/// `x` is `[n, c, h, w]`, `dy` `[n, o, out_h, out_w]`, `dw` `[o, c, kh, kw]`; `scratch` has [`conv2d_dw_scratch_len`]
/// elements with any content. Contributions of images are added in their order.
///
/// # Panics
///
/// If a length does not fit the shape.
#[inline(never)]
pub fn conv2d_dw<T: Real>(shape: &Conv2dShape, x: &[T], dy: &[T], dw: Target<T>, scratch: &mut [T]) {
    let (dw, mut beta) = dw;
    shape.check(x.len(), dw.len(), dy.len());
    let (depth, pixels) = (shape.depth(), shape.pixels());
    if shape.n == 0 || depth == 0 || pixels == 0 {
        return dw.iter_mut().for_each(|dw| put(dw, beta, T::ZERO));
    }
    let windows = shape.windows(x);
    if direct::suits(&windows) {
        return direct::weights(&windows, [shape.n, shape.o, shape.out_h()], dy, dw, beta, scratch);
    }
    let image = shape.c * shape.h * shape.w;
    for (x, dy) in x.chunks_exact(image).zip(dy.chunks_exact(shape.o * pixels)) {
        let (dy, dw) = (Mat::new(dy, shape.o, pixels), MatMut::new(&mut *dw, shape.o, depth));
        let product = Product { alpha: T::ONE, a: dy.batch(0), b: &WindowRows(shape.windows(x)), beta, pairs: false };
        product.run(1, dw.batch(0), true);
        beta = T::ONE;
    }
}

/// Gradient of [`conv2d_forward`] with respect to the bias: `db[o]` is the sum of `dy[n, o, ..]`, with `dy` `[n, o,
/// pixels]`.
#[inline(never)]
pub fn conv2d_db<T: Real>(o: usize, pixels: usize, dy: &[T], db: Target<T>) {
    let (db, beta) = db;
    assert_eq!(db.len(), o, "conv2d: bias length");
    for_chunks(db, 1, |o_index, db| {
        let planes = (o_index * pixels..dy.len()).step_by((o * pixels).max(1));
        let sum = planes.map(|at| crate::reduce::sum_serial(&dy[at..at + pixels])).fold(T::ZERO, |a, b| a + b);
        put(&mut db[0], beta, sum);
    });
}
