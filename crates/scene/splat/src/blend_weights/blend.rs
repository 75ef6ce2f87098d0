//! Products with the weights of an image, on the tape.

use super::BlendWeights;
use std::ops::Range;
use std::sync::Arc;
use weaver_autograd::{Backward, Op, Pool, Shape, ShapeError, Shapes, Var, View, ViewMut, ensure_shape};
use weaver_kernels::{Real, parallel};

/// Pixels that are worked on together.
const GRAIN: usize = 256;
/// The most parts of the pixels that are gathered from at once, each into sums of its own.
const PARTS: usize = 16;

impl<T: Real> BlendWeights<T> {
    /// Features `[N, C]` as the pixels show them `[P, C]`, W F, over zeros. Differentiable in the features. Same bits
    /// at any number of threads.
    ///
    /// ```
    /// # use std::sync::Arc;
    /// # use weaver_autograd::Tape;
    /// # use weaver_scene::{CameraSlices, Color, GaussianSlices, Model};
    /// # use weaver_splat::{BlendWeights, Images, RasterSettings, Workspace, rasterize};
    /// # let gaussians = GaussianSlices {
    /// #     means: &[0.0_f32, 0.0, 2.0, 0.0, 0.0, 3.0],
    /// #     quats: &[1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0],
    /// #     scales: &[0.5; 6],
    /// #     opacities: &[0.5, 0.5],
    /// #     color: Color::None,
    /// #     features: None,
    /// #     groups: None,
    /// # };
    /// # let cameras = CameraSlices {
    /// #     viewmats: &[1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0],
    /// #     intrinsics: &[10.0, 10.0, 0.5, 0.5],
    /// #     background: &[0.0; 3],
    /// #     width: 1,
    /// #     height: 1,
    /// #     model: Model::Pinhole,
    /// # };
    /// # let mut alpha = [0.0];
    /// # let images = Images { image: &mut [], alpha: &mut alpha, depth: None, features: None };
    /// let mut workspace = Workspace::new();
    /// rasterize(&gaussians, &cameras, &RasterSettings::default(), &mut workspace, images)?;
    /// let weights = Arc::new(BlendWeights::of(&workspace)?);
    /// let tape = Tape::new();
    /// let features = tape.leaf(&[1.0, 10.0, 2.0, 20.0], [2, 2]);
    /// assert_eq!(weights.blend(features).to_vec(), [1.0, 10.0]); // 0.5 of the first, 0.25 of the second
    /// # Ok::<(), weaver_splat::RasterError>(())
    /// ```
    ///
    /// # Panics
    /// If there are not N rows.
    #[track_caller]
    pub fn blend<'t>(self: &Arc<Self>, features: Var<'t, T>) -> Var<'t, T> {
        let [blended] = features.tape().apply(Blend(self.clone()), &[features]);
        blended
    }
}

/// The products. A few channels, known when compiled, stay in registers.
impl<T: Real> BlendWeights<T> {
    /// Rows of W F from pixel `first` on.
    fn spread<const C: usize>(&self, (features, first, out): (&[T], usize, &mut [T])) {
        let (features, out) = (features.as_chunks::<C>().0, out.as_chunks_mut::<C>().0);
        for (i, out) in out.iter_mut().enumerate() {
            let mut sum = [T::ZERO; C];
            for (gaussian, weight) in self.of_pixel(first + i) {
                let x = &features[gaussian];
                (0..C).for_each(|c| sum[c] += weight * x[c]);
            }
            *out = sum;
        }
    }

    fn spread_many(&self, (features, first, out): (&[T], usize, &mut [T]), channels: usize) {
        for (i, out) in out.chunks_exact_mut(channels).enumerate() {
            out.fill(T::ZERO);
            for (gaussian, weight) in self.of_pixel(first + i) {
                let x = &features[gaussian * channels..][..channels];
                out.iter_mut().zip(x).for_each(|(out, x)| *out += weight * *x);
            }
        }
    }

    /// Adds the rows of some pixels to what the Gaussians gather.
    fn gather<const C: usize>(&self, (slopes, pixels, sums): (&[T], Range<usize>, &mut [T])) {
        let (slopes, sums) = (slopes.as_chunks::<C>().0, sums.as_chunks_mut::<C>().0);
        for pixel in pixels {
            let slope = slopes[pixel];
            for (gaussian, weight) in self.of_pixel(pixel) {
                let sum = &mut sums[gaussian];
                (0..C).for_each(|c| sum[c] += weight * slope[c]);
            }
        }
    }

    fn gather_many(&self, (slopes, pixels, sums): (&[T], Range<usize>, &mut [T]), channels: usize) {
        for pixel in pixels {
            let slope = &slopes[pixel * channels..][..channels];
            for (gaussian, weight) in self.of_pixel(pixel) {
                let sum = &mut sums[gaussian * channels..][..channels];
                sum.iter_mut().zip(slope).for_each(|(sum, x)| *sum += weight * *x);
            }
        }
    }
}

#[derive(Debug)]
struct Blend<T>(Arc<BlendWeights<T>>);

impl<T: Real> Op<T> for Blend<T> {
    fn name(&self) -> &'static str {
        "blend_weights"
    }

    fn shapes(&self, ins: &[Shape]) -> Result<Shapes, ShapeError> {
        let n = self.0.gaussians;
        ensure_shape!(ins.len() == 1 && ins[0].rank() == 2 && ins[0][0] == n, "features [{n}, C]");
        Ok(Shapes::one([self.0.pixels(), ins[0][1]]))
    }

    fn forward(&mut self, ins: &[View<'_, T>], outs: &mut [ViewMut<'_, T>], _pool: &Pool) {
        let (features, channels) = (&*ins[0], ins[0].shape()[1]);
        parallel::for_chunks(&mut outs[0], GRAIN * channels, |chunk, out| {
            let of_chunk = (features, chunk * GRAIN, out);
            match channels {
                1 => self.0.spread::<1>(of_chunk),
                2 => self.0.spread::<2>(of_chunk),
                3 => self.0.spread::<3>(of_chunk),
                4 => self.0.spread::<4>(of_chunk),
                _ => self.0.spread_many(of_chunk, channels),
            }
        });
    }

    fn backward(&self, at: Backward<'_, '_, T>) {
        let Backward { douts, dins, pool, .. } = at;
        let [Some(gradient)] = dins else { return };
        let (slopes, channels) = (&*douts[0], douts[0].shape()[1]);
        let len = self.0.gaussians * channels;
        if len == 0 {
            return gradient.add_zero();
        }
        // As many parts as are worth their sums, and they do not depend on threads.
        let parts = (self.0.hits.len() / (4 * self.0.gaussians)).clamp(1, PARTS);
        let pixels = self.0.pixels().div_ceil(parts);
        let mut sums = pool.filled(parts * len, T::ZERO);
        parallel::for_chunks(&mut sums, len, |part, sums| {
            let pixels = part * pixels..((part + 1) * pixels).min(self.0.pixels());
            let of_part = (slopes, pixels, sums);
            match channels {
                1 => self.0.gather::<1>(of_part),
                2 => self.0.gather::<2>(of_part),
                3 => self.0.gather::<3>(of_part),
                4 => self.0.gather::<4>(of_part),
                _ => self.0.gather_many(of_part, channels),
            }
        });
        gradient.add_each(|i| sums.iter().skip(i).step_by(len).copied().sum());
    }
}
