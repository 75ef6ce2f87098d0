//! Transposed convolution.

use crate::{Backward, Op, Pool, Shape, ShapeError, Shapes, Var, View, ViewMut, ensure_shape};
use weaver_kernels::{Real, conv};

#[derive(Debug)]
struct ConvTranspose2d {
    stride: usize,
}

impl ConvTranspose2d {
    /// The shape of the convolution that is transposed, which leads from the result to x.
    fn size(&self, x: Shape, w: Shape) -> conv::Conv2dShape {
        let along = |n: usize, k: usize| if n == 0 { 0 } else { (n - 1) * self.stride + k };
        let (h, wide) = (along(x[2], w[2]), along(x[3], w[3]));
        conv::Conv2dShape { n: x[0], c: w[1], h, w: wide, o: x[1], kh: w[2], kw: w[3], stride: self.stride, pad: 0 }
    }
}

impl<T: Real> Op<T> for ConvTranspose2d {
    fn name(&self) -> &'static str {
        "conv_transpose2d"
    }
    fn shapes(&self, ins: &[Shape]) -> Result<Shapes, ShapeError> {
        let (x, w) = (ins[0], ins[1]);
        ensure_shape!(
            x.rank() == 4 && w.rank() == 4 && x[1] == w[0] && ins.get(2).is_none_or(|b| *b == Shape::from([w[1]])),
            "x [N, I, H, W], w [I, O, kh, kw], b [O]"
        );
        let size = self.size(x, w);
        Ok(Shapes::one([x[0], w[1], size.h, size.w]))
    }
    fn forward(&mut self, ins: &[View<'_, T>], outs: &mut [ViewMut<'_, T>], pool: &Pool) {
        let size = self.size(ins[0].shape(), ins[1].shape());
        let mut scratch = pool.buffer(conv::conv_transpose2d_scratch_len(&size));
        let b = ins.get(2).map(View::data);
        conv::conv_transpose2d_forward(&size, &ins[0], &ins[1], b, &mut outs[0], &mut scratch);
    }
    fn backward(&self, at: Backward<'_, '_, T>) {
        let Backward { ins, douts, dins, pool, .. } = at;
        let (x, w, dy) = (&ins[0], &ins[1], &douts[0]);
        let size = self.size(x.shape(), w.shape());
        if let Some(dx) = &mut dins[0] {
            conv::conv_transpose2d_dx(&size, w, dy, dx.target());
        }
        if let Some(dw) = &mut dins[1] {
            let mut scratch = pool.buffer(conv::conv2d_dw_scratch_len::<T>(&size));
            conv::conv_transpose2d_dw(&size, x, dy, dw.target(), &mut scratch);
        }
        if let Some(Some(db)) = dins.get_mut(2) {
            conv::conv2d_db(size.c, size.h * size.w, dy, db.target());
        }
    }
}

/// Transposed convolution without padding, the adjoint of [`conv2d`](super::conv2d()), used to enlarge maps: `y[n, o, i
/// stride + p, j stride + q] = b[o] + sum over c of w[c, o, p, q] x[n, c, i, j]`, summed where windows overlap.
///
/// x `[N, I, H, W]`, w `[I, O, kh, kw]`, b `[O]` or none; the result is `[N, O, (H - 1) stride + kh, (W - 1) stride +
/// kw]`. Differentiable in all three.
///
/// ```
/// use weaver_autograd::{Tape, ops};
/// let tape = Tape::<f32>::new();
/// let (x, w) = (tape.constant(&[1.0, 2.0], [1, 1, 1, 2]), tape.constant(&[1.0, 10.0], [1, 1, 1, 2]));
/// assert_eq!(ops::conv_transpose2d(x, w, None, 2).to_vec(), [1.0, 10.0, 2.0, 20.0]);
/// ```
#[track_caller]
pub fn conv_transpose2d<'t, T: Real>(x: Var<'t, T>, w: Var<'t, T>, b: Option<Var<'t, T>>, stride: usize) -> Var<'t, T> {
    assert!(stride > 0, "conv_transpose2d: the stride is at least 1");
    let op = ConvTranspose2d { stride };
    let [y] = match b {
        Some(b) => x.tape().apply(op, &[x, w, b]),
        None => x.tape().apply(op, &[x, w]),
    };
    y
}
