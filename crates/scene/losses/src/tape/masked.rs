//! Images with pixels that do not count.

use super::mse;
use weaver_autograd::{Backward, Op, Pool, Real, Shape, ShapeError, Shapes, Var, View, ViewMut, ensure_shape};

#[derive(Debug)]
struct InsideOf {
    /// `[N, H, W]`
    inside: Vec<bool>,
}

impl InsideOf {
    /// The mask of each plane of images `[N, C, H, W]`.
    fn planes(&self, shape: Shape) -> impl Iterator<Item = &[bool]> {
        let (channels, pixels) = (shape[1], (shape[2] * shape[3]).max(1));
        self.inside.chunks(pixels).flat_map(move |mask| std::iter::repeat_n(mask, channels))
    }
}

impl<T: Real> Op<T> for InsideOf {
    fn name(&self) -> &'static str {
        "inside_of"
    }
    fn shapes(&self, ins: &[Shape]) -> Result<Shapes, ShapeError> {
        let pixels = self.inside.len();
        let fits = |s: Shape| s.rank() == 4 && s[0] * s[2] * s[3] == pixels;
        ensure_shape!(
            ins.len() == 1 && fits(ins[0]),
            "images [N, C, H, W] of {pixels} pixels, as many as the mask has"
        );
        Ok(Shapes::one(ins[0]))
    }
    fn forward(&mut self, ins: &[View<'_, T>], outs: &mut [ViewMut<'_, T>], _pool: &Pool) {
        let shape = ins[0].shape();
        let pixels = (shape[2] * shape[3]).max(1);
        let planes = ins[0].chunks(pixels).zip(outs[0].chunks_mut(pixels));
        for (mask, (from, to)) in self.planes(shape).zip(planes) {
            for ((to, from), inside) in to.iter_mut().zip(from).zip(mask) {
                *to = if *inside { *from } else { T::ZERO };
            }
        }
    }
    fn backward(&self, at: Backward<'_, '_, T>) {
        let Backward { ins, douts, dins, .. } = at;
        let Some(dx) = &mut dins[0] else { return };
        let shape = ins[0].shape();
        let pixels = (shape[2] * shape[3]).max(1);
        let planes = douts[0].chunks(pixels).zip(dx.accumulator().chunks_mut(pixels));
        for (mask, (from, to)) in self.planes(shape).zip(planes) {
            let kept = to.iter_mut().zip(from).zip(mask).filter(|(_, inside)| **inside);
            kept.for_each(|((to, from), _)| *to += *from);
        }
    }
}

/// Images `[N, C, H, W]` where a mask `inside` `[N, H, W]` is true, and 0 elsewhere, even in place of NaN.
///
/// Differentiable in the images; outside the gradient is exactly 0. Panics unless the mask has a value for each pixel.
///
/// ```
/// use weaver_autograd::Tape;
/// let tape = Tape::<f32>::new();
/// let x = tape.leaf(&[1.0, f32::NAN], [1, 1, 1, 2]);
/// let kept = weaver_losses::inside_of(x, &[true, false]);
/// kept.sum().backward();
/// assert_eq!((kept.to_vec(), x.grad().unwrap()), (vec![1.0, 0.0], vec![1.0, 0.0]));
/// ```
#[track_caller]
pub fn inside_of<'t, T: Real>(images: Var<'t, T>, inside: &[bool]) -> Var<'t, T> {
    let [kept] = images.tape().apply(InsideOf { inside: inside.to_vec() }, &[images]);
    kept
}

/// The mean over *all* elements of (M render - M target)^2, a scalar, where M is 1 inside a mask and 0 elsewhere.
///
/// Both images are `[N, C, H, W]`, the mask `inside` is `[N, H, W]`. Differentiable in both; pixels outside have no
/// influence and no gradient, NaN included. With a mask that is true everywhere, [`mse`] to the bit. Source: Fujimura
/// et al., WildSplatter, arXiv 2604.21182 (as released: the mean ignores the size of the mask).
///
/// ```
/// use weaver_autograd::Tape;
/// let tape = Tape::<f64>::new();
/// let render = tape.leaf(&[0.5, 0.9], [1, 1, 1, 2]);
/// let target = tape.constant(&[0.0, f64::NAN], [1, 1, 1, 2]);
/// assert_eq!(weaver_losses::masked_mse(render, target, &[true, false]).item(), 0.125);
/// ```
#[track_caller]
pub fn masked_mse<'t, T: Real>(render: Var<'t, T>, target: Var<'t, T>, inside: &[bool]) -> Var<'t, T> {
    mse(inside_of(render, inside), inside_of(target, inside))
}
