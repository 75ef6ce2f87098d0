//! Normalization of images by ImageNet's statistics, which the backbone expects.

use weaver_autograd::{Backward, Op, Pool, Real, Shape, ShapeError, Shapes, Var, View, ViewMut, ensure_shape};
use weaver_kernels::parallel;

/// Mean of ImageNet's red, green and blue in `[0, 1]`; single precision, as the published code has it.
pub const IMAGENET_MEAN: [f32; 3] = [0.485, 0.456, 0.406];
/// Standard deviation of ImageNet's red, green and blue in `[0, 1]`.
pub const IMAGENET_STD: [f32; 3] = [0.229, 0.224, 0.225];

#[derive(Debug)]
struct NormalizeImage;

/// The color channel of a plane.
fn channel(plane: usize) -> usize {
    plane % 3
}

impl<T: Real> Op<T> for NormalizeImage {
    fn name(&self) -> &'static str {
        "normalize_image"
    }

    fn shapes(&self, ins: &[Shape]) -> Result<Shapes, ShapeError> {
        ensure_shape!(ins.len() == 1 && ins[0].rank() >= 3 && ins[0][ins[0].rank() - 3] == 3, "images [.., 3, H, W]");
        Ok(Shapes::one(ins[0]))
    }

    fn forward(&mut self, ins: &[View<'_, T>], outs: &mut [ViewMut<'_, T>], _pool: &Pool) {
        let shape = ins[0].shape();
        let plane = shape.last() * shape[shape.rank() - 2];
        parallel::for_chunks(&mut outs[0], plane, |i, y| {
            let (mean, std) = (T::from_f32(IMAGENET_MEAN[channel(i)]), T::from_f32(IMAGENET_STD[channel(i)]));
            y.iter_mut().zip(&ins[0].data()[i * plane..]).for_each(|(y, x)| *y = (*x - mean) / std);
        });
    }

    fn backward(&self, at: Backward<'_, '_, T>) {
        let Backward { ins, douts, dins, .. } = at;
        let shape = ins[0].shape();
        let plane = shape.last() * shape[shape.rank() - 2];
        if let Some(dx) = &mut dins[0] {
            dx.add_each(|i| douts[0][i] / T::from_f32(IMAGENET_STD[channel(i / plane)]));
        }
    }
}

/// (x - mean) / std per color channel, with ImageNet's statistics.
///
/// `images` `[.., 3, H, W]` in `[0, 1]` gives the same shape. Differentiable.
#[track_caller]
pub fn normalize_image<T: Real>(images: Var<'_, T>) -> Var<'_, T> {
    let [y] = images.tape().apply(NormalizeImage, &[images]);
    y
}
