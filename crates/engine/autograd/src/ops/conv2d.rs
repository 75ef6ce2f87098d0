//! Two-dimensional convolution.

use crate::{Backward, Op, Pool, Shape, ShapeError, Shapes, Var, View, ViewMut, ensure_shape};
use weaver_kernels::{Real, conv};

#[derive(Debug)]
struct Conv2d {
    stride: usize,
    padding: usize,
}

impl Conv2d {
    fn size(&self, x: Shape, w: Shape) -> conv::Conv2dShape {
        let Self { stride, padding } = *self;
        conv::Conv2dShape { n: x[0], c: x[1], h: x[2], w: x[3], o: w[0], kh: w[2], kw: w[3], stride, pad: padding }
    }
}

impl<T: Real> Op<T> for Conv2d {
    fn name(&self) -> &'static str {
        "conv2d"
    }
    fn shapes(&self, ins: &[Shape]) -> Result<Shapes, ShapeError> {
        let (x, w) = (ins[0], ins[1]);
        ensure_shape!(
            x.rank() == 4 && w.rank() == 4 && x[1] == w[1] && ins.get(2).is_none_or(|b| *b == Shape::from([w[0]])),
            "x [N, C, H, W], w [O, C, kh, kw], b [O]"
        );
        let size = self.size(x, w);
        Ok(Shapes::one([x[0], w[0], size.out_h(), size.out_w()]))
    }
    fn forward(&mut self, ins: &[View<'_, T>], outs: &mut [ViewMut<'_, T>], _pool: &Pool) {
        let size = self.size(ins[0].shape(), ins[1].shape());
        conv::conv2d_forward(&size, &ins[0], &ins[1], ins.get(2).map(View::data), &mut outs[0]);
    }
    fn backward(&self, at: Backward<'_, '_, T>) {
        let Backward { ins, douts, dins, pool, .. } = at;
        let (x, w, dy) = (&ins[0], &ins[1], &douts[0]);
        let size = self.size(x.shape(), w.shape());
        if let Some(dx) = &mut dins[0] {
            let mut scratch = pool.buffer(conv::conv2d_dx_scratch_len(&size));
            conv::conv2d_dx(&size, w, dy, dx.target(), &mut scratch);
        }
        if let Some(dw) = &mut dins[1] {
            let mut scratch = pool.buffer(conv::conv2d_dw_scratch_len::<T>(&size));
            conv::conv2d_dw(&size, x, dy, dw.target(), &mut scratch);
        }
        if let Some(Some(db)) = dins.get_mut(2) {
            conv::conv2d_db(size.o, size.out_h() * size.out_w(), dy, db.target());
        }
    }
}

/// Two-dimensional convolution with zero padding. As usual in neural networks, the kernel is not flipped:
/// `y[n, o, i, j] = b[o] + sum over c, p, q of w[o, c, p, q] x[n, c, i stride + p - padding, j stride + q - padding]`.
///
/// x `[N, C, H, W]`, w `[O, C, kh, kw]`, b `[O]` or none; the result is `[N, O, H', W']` with
/// `H' = (H + 2 padding - kh) / stride + 1`, rounded down. Differentiable in all three.
///
/// ```
/// use weaver_autograd::{Tape, ops};
/// let tape = Tape::<f32>::new();
/// let (x, w) = (tape.constant(&[1.0, 2.0, 3.0], [1, 1, 1, 3]), tape.constant(&[1.0, 10.0], [1, 1, 1, 2]));
/// assert_eq!(ops::conv2d(x, w, None, 1, 0).to_vec(), [21.0, 32.0]);
/// ```
#[track_caller]
pub fn conv2d<'t, T: Real>(
    x: Var<'t, T>,
    w: Var<'t, T>,
    b: Option<Var<'t, T>>,
    stride: usize,
    padding: usize,
) -> Var<'t, T> {
    assert!(stride > 0, "conv2d: the stride is at least 1");
    let op = Conv2d { stride, padding };
    let [y] = match b {
        Some(b) => x.tape().apply(op, &[x, w, b]),
        None => x.tape().apply(op, &[x, w]),
    };
    y
}
