//! Two-dimensional convolution (cross-correlation, as neural networks mean it) and its transpose, on
//! `[N, C, H, W]` maps with zero padding.
//!
//! A convolution is the product of the weights with a matrix of shifted windows of the input, which never exists: at stride 1
//! the tiles of [`gemm`](crate::gemm) read the windows where they lie in the padded input, otherwise they are written
//! straight into the panels that it packs.

use crate::Real;
use crate::extent::product;
use crate::gemm::{Mat, Product, gemm_batched};
use crate::parallel::for_chunks;
use crate::target::{Target, put};

mod direct;
mod transposed;
mod windows;

pub use transposed::{
    conv_transpose2d_dw, conv_transpose2d_dx, conv_transpose2d_forward, conv_transpose2d_scratch_len,
};
use windows::{WindowRows, Windows};

/// The sizes of a convolution from `[n, c, h, w]` to `[n, o, out_h(), out_w()]` with weights
/// `[o, c, kh, kw]`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Conv2d {
    /// Images.
    pub n: usize,
    /// Input channels.
    pub c: usize,
    /// Input height.
    pub h: usize,
    /// Input width.
    pub w: usize,
    /// Output channels.
    pub o: usize,
    /// Kernel height.
    pub kh: usize,
    /// Kernel width.
    pub kw: usize,
    /// Step between windows, both ways.
    pub stride: usize,
    /// Zeros around the input, on all four sides.
    pub pad: usize,
}

impl Conv2d {
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

    /// Elements of a window: rows of the window matrix.
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
        // A 1 x 1 kernel sees one long row.
        if [self.kh, self.kw, self.stride, self.pad] == [1, 1, 1, 0] {
            let pixels = self.h * self.w;
            return Windows { x, c: self.c, h: 1, w: pixels, kh: 1, kw: 1, stride: 1, pads, out_w: pixels };
        }
        let Self { c, h, w, kh, kw, stride, .. } = *self;
        Windows { x, c, h, w, kh, kw, stride, pads, out_w: self.out_w() }
    }
}

/// y = w * x + b: `y[n, o, i, j] = b[o] + sum w[o, c, p, q] x[n, c, i stride + p - pad, j stride + q - pad]`.
///
/// `x` is `[n, c, h, w]`, `w` `[o, c, kh, kw]`, `b` `[o]` if there is one, `y` `[n, o, out_h, out_w]`.
/// Panics if a length does not fit.
///
/// ```
/// use weaver_kernels::conv::{Conv2d, conv2d_forward};
/// let size = Conv2d { n: 1, c: 1, h: 1, w: 3, o: 1, kh: 1, kw: 3, stride: 1, pad: 0 };
/// let mut y = [0.0];
/// conv2d_forward(&size, &[1.0, 2.0, 3.0], &[1.0, 10.0, 100.0], Some(&[0.5]), &mut y);
/// assert_eq!(y, [321.5]);
/// ```
pub fn conv2d_forward<T: Real>(size: &Conv2d, x: &[T], w: &[T], b: Option<&[T]>, y: &mut [T]) {
    let beta = match b {
        Some(b) => {
            assert_eq!(b.len(), size.o, "conv2d: bias length of {size:?}");
            for_chunks(y, size.pixels(), |plane, y| y.fill(b[plane % size.o]));
            T::ONE
        }
        None => T::ZERO,
    };
    correlate(size, x, w, (y, beta));
}

/// y = beta y + w * x.
fn correlate<T: Real>(size: &Conv2d, x: &[T], w: &[T], y: Target<T>) {
    let (y, beta) = y;
    size.check(x.len(), w.len(), y.len());
    let (depth, pixels) = (size.depth(), size.pixels());
    let windows = size.windows(x);
    if direct::suits(&windows) {
        return direct::forward(&windows, [size.n, size.o, size.out_h()], w, y, beta);
    }
    Product {
        batch: size.n,
        a_step: 0,
        c_step: size.o * pixels,
        m: size.o,
        n: pixels,
        k: depth,
        alpha: T::ONE,
        a: Mat::new(w, depth),
        b: &windows,
        beta,
        pairs: false,
    }
    .run(y, pixels, true);
}

/// Length of the scratch that [`conv2d_dx`] wants.
pub fn conv2d_dx_scratch_len(size: &Conv2d) -> usize {
    if size.stride == 1 { size.o * size.depth() } else { size.n * size.depth() * size.pixels() }
}

/// Gradient with respect to the input: `w` `[o, c, kh, kw]`, `dy` `[n, o, out_h, out_w]`, `dx`
/// `[n, c, h, w]`, `scratch` of [`conv2d_dx_scratch_len`] elements with any content.
pub fn conv2d_dx<T: Real>(size: &Conv2d, w: &[T], dy: &[T], dx: Target<T>, scratch: &mut [T]) {
    let (dx, beta) = dx;
    size.check(dx.len(), w.len(), dy.len());
    let Conv2d { n, c, h, w: width, o, kh, kw, pad, .. } = *size;
    let scratch = &mut scratch[..conv2d_dx_scratch_len(size)];
    if size.stride > 1 {
        let (depth, pixels) = (size.depth(), size.pixels());
        gemm_batched(n, true, false, depth, pixels, o, T::ONE, w, 0, dy, o * pixels, T::ZERO, scratch, depth * pixels);
        return gather_windows(size, scratch, dx, beta);
    }
    // At stride 1 it is a convolution of dy with the kernel turned by half a turn.
    let taps = kh * kw;
    for_chunks(scratch, o * taps, |c, turned| {
        for (o, turned) in turned.chunks_exact_mut(taps).enumerate() {
            let kernel = &w[(o * size.c + c) * taps..][..taps];
            turned.iter_mut().zip(kernel.iter().rev()).for_each(|(t, w)| *t = *w);
        }
    });
    let windows = Windows {
        x: dy,
        c: o,
        h: size.out_h(),
        w: size.out_w(),
        kh,
        kw,
        stride: 1,
        pads: [kh, kw].map(|k| k as isize - 1 - pad as isize),
        out_w: width,
    };
    if direct::suits(&windows) {
        return direct::forward(&windows, [n, c, h], scratch, dx, beta);
    }
    Product {
        batch: n,
        a_step: 0,
        c_step: c * h * width,
        m: c,
        n: h * width,
        k: o * taps,
        alpha: T::ONE,
        a: Mat::new(scratch, o * taps),
        b: &windows,
        beta,
        pairs: false,
    }
    .run(dx, h * width, true);
}

/// The adjoint of taking windows: `dx[n, c, y, x]` = sum of the window elements that saw it.
/// `windows` is `[n, c kh kw, out_h out_w]`.
fn gather_windows<T: Real>(size: &Conv2d, windows: &[T], dx: &mut [T], beta: T) {
    let Conv2d { h, w, kh, kw, stride, pad, .. } = *size;
    let (out_h, out_w) = (size.out_h(), size.out_w());
    // The window that has element k at padded position `at`, if there is one.
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

/// Length of the scratch that [`conv2d_dw`] wants.
pub fn conv2d_dw_scratch_len<T: Real>(size: &Conv2d) -> usize {
    let windows = size.windows::<T>(&[]);
    if direct::suits(&windows) { direct::weights_scratch_len(&windows, size.o, size.out_h()) } else { 0 }
}

/// Gradient with respect to the weights: `x` `[n, c, h, w]`, `dy` `[n, o, out_h, out_w]`, `dw`
/// `[o, c, kh, kw]`, `scratch` of [`conv2d_dw_scratch_len`] elements with any content; images are added in their order.
pub fn conv2d_dw<T: Real>(size: &Conv2d, x: &[T], dy: &[T], dw: Target<T>, scratch: &mut [T]) {
    let (dw, mut beta) = dw;
    size.check(x.len(), dw.len(), dy.len());
    let (depth, pixels) = (size.depth(), size.pixels());
    if size.n == 0 || depth == 0 || pixels == 0 {
        return dw.iter_mut().for_each(|dw| put(dw, beta, T::ZERO));
    }
    let windows = size.windows(x);
    if direct::suits(&windows) {
        return direct::weights(&windows, [size.n, size.o, size.out_h()], dy, dw, beta, scratch);
    }
    let image = size.c * size.h * size.w;
    for (x, dy) in x.chunks_exact(image).zip(dy.chunks_exact(size.o * pixels)) {
        Product {
            batch: 1,
            a_step: 0,
            c_step: 0,
            m: size.o,
            n: depth,
            k: pixels,
            alpha: T::ONE,
            a: Mat::new(dy, pixels),
            b: &WindowRows(size.windows(x)),
            beta,
            pairs: false,
        }
        .run(dw, depth, true);
        beta = T::ONE;
    }
}

/// Gradient with respect to the bias, `db[o]` = sum of `dy[n, o, ..]`: `dy` is `[n, o, pixels]`.
pub fn conv2d_db<T: Real>(o: usize, pixels: usize, dy: &[T], db: Target<T>) {
    let (db, beta) = db;
    assert_eq!(db.len(), o, "conv2d: bias length");
    for_chunks(db, 1, |o_index, db| {
        let planes = (o_index * pixels..dy.len()).step_by((o * pixels).max(1));
        let sum = planes.map(|at| crate::reduce::sum_serial(&dy[at..at + pixels])).fold(T::ZERO, |a, b| a + b);
        put(&mut db[0], beta, sum);
    });
}
