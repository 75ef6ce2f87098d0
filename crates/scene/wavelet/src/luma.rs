//! Brightness of an RGB image.

use weaver_autograd::{Backward, Op, Pool, Real, Shape, ShapeError, Shapes, Var, View, ViewMut, ensure_shape};
use weaver_kernels::parallel;

/// Weights of red, green and blue (ITU-R BT.601).
pub const LUMA_WEIGHTS: [f64; 3] = [0.299, 0.587, 0.114];

/// Writes the luma Y = 0.299 R + 0.587 G + 0.114 B of images `[N, 3, H, W]` to `out` `[N, H, W]`, with `pixels` = H W.
pub fn luma_into<T: Real>(images: &[T], pixels: usize, out: &mut [T]) {
    let weights = LUMA_WEIGHTS.map(T::from_f64);
    parallel::for_chunks(out, pixels, |n, out| {
        let image = &images[3 * n * pixels..3 * (n + 1) * pixels];
        let (red, rest) = image.split_at(pixels);
        let (green, blue) = rest.split_at(pixels);
        for (y, ((r, g), b)) in out.iter_mut().zip(red.iter().zip(green).zip(blue)) {
            *y = weights[0] * *r + weights[1] * *g + weights[2] * *b;
        }
    });
}

#[derive(Debug)]
struct Luma;

impl<T: Real> Op<T> for Luma {
    fn name(&self) -> &'static str {
        "luma"
    }
    fn shapes(&self, ins: &[Shape]) -> Result<Shapes, ShapeError> {
        ensure_shape!(ins.len() == 1 && ins[0].rank() == 4 && ins[0][1] == 3, "images [N, 3, H, W]");
        Ok(Shapes::one([ins[0][0], ins[0][2], ins[0][3]]))
    }
    fn forward(&mut self, ins: &[View<'_, T>], outs: &mut [ViewMut<'_, T>], _pool: &Pool) {
        let shape = ins[0].shape();
        luma_into(&ins[0], shape[2] * shape[3], &mut outs[0]);
    }
    fn backward(&self, at: Backward<'_, '_, T>) {
        let Backward { ins, douts, dins, .. } = at;
        let Some(dx) = &mut dins[0] else { return };
        let pixels = ins[0].shape()[2] * ins[0].shape()[3];
        let (dx, beta) = dx.target();
        parallel::for_chunks(dx, pixels, |plane, dx| {
            let weight = T::from_f64(LUMA_WEIGHTS[plane % 3]);
            let dy = &douts[0][plane / 3 * pixels..][..pixels];
            for (dx, dy) in dx.iter_mut().zip(dy) {
                let before = if beta == T::ZERO { T::ZERO } else { *dx };
                *dx = before + weight * *dy;
            }
        });
    }
}

/// The luma Y = 0.299 R + 0.587 G + 0.114 B of images in [0, 1].
///
/// Images `[N, 3, H, W]` give `[N, H, W]`. Linear and differentiable. Panics unless x is `[N, 3, H, W]`.
#[track_caller]
pub fn luma<T: Real>(x: Var<'_, T>) -> Var<'_, T> {
    let [y] = x.tape().apply(Luma, &[x]);
    y
}
