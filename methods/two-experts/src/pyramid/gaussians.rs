//! Raw numbers of pixels to Gaussians.

use super::opacity::{Opacities, OpacityDegree};
use weaver_autograd::{Real, Var, ops};
use weaver_geometry::sh;
use weaver_pose::Rays;
use weaver_splat::GaussianVars;

/// Offsets of the numbers of a pixel: position 3, color 12, scales 3, quaternion 4, opacity.
const COLORS: usize = 3;
const SCALES: usize = 15;
const QUATERNION: usize = 18;
const OPACITY: usize = 22;
/// Degree-1 harmonics of a color.
const COLOR_HARMONICS: usize = 4;
/// Decoding of raw numbers to Gaussians.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Parametrization {
    /// As published, for worlds with cameras within 1 of the origin: distance 500 sigmoid(mean of three), scales
    /// exp(min(raw - 6.9, -1.2)), 2 taken off the opacity.
    Published,
    /// Relative to a pixel's footprint at the distance rho: rho = exp(clamp(mean of three, +-4)), scales `scale` rho /
    /// fx exp(clamp(raw, +-3)), and the pixel's own color is added.
    Footprint {
        /// Scale of a raw 0, in footprints.
        scale: f64,
    },
}

/// Output of the network for each pixel.
#[derive(Clone, Copy, Debug)]
pub struct RawGaussians<'t, T: Real = f32> {
    /// `[V H W, numbers]`
    pub raw: Var<'t, T>,
    /// The pixels' rays.
    pub rays: Rays<'t, T>,
    /// Meaning of the last numbers: a constant opacity, or harmonics.
    pub opacity: OpacityDegree,
}

impl<'t, T: Real> RawGaussians<'t, T> {
    /// Numbers of a pixel.
    pub fn numbers(opacity: OpacityDegree) -> usize {
        OPACITY + opacity.numbers()
    }

    /// The Gaussians, in the frame of the rays, and their depth `[V, H, W]`, from the `intrinsics` `[V, 4]` and
    /// `photos` `[V, 3, H, W]` of the rays. View-dependent opacities stand here as their mean logit;
    /// [`RawGaussians::opacities`] evaluates them for a camera.
    #[track_caller]
    pub fn gaussians(
        &self,
        parametrization: Parametrization,
        intrinsics: Var<'t, T>,
        photos: Var<'t, T>,
    ) -> (GaussianVars<'t, T>, Var<'t, T>) {
        let [views, pixels] = [0, 1].map(|axis| self.rays.directions.shape()[axis]);
        let n = views * pixels;
        let part = |first: usize, count: usize| self.raw.slice(1, first, count);
        let position = part(0, 3).mean_axis(1);
        let colors = part(COLORS, 3 * COLOR_HARMONICS).reshape([n, 3, COLOR_HARMONICS]).permute(&[0, 2, 1]);
        let (raw_scales, quats) = (part(SCALES, 3), part(QUATERNION, 4));
        let (distance, scales, quats, colors) = match parametrization {
            Parametrization::Published => {
                let distance = position.sigmoid() * 500.0;
                let scales = (raw_scales - 6.9).clamp(f64::MIN, -1.2).exp();
                (distance, scales, quats, colors)
            }
            Parametrization::Footprint { scale } => {
                let distance = position.clamp(-4.0, 4.0).exp();
                let focal = intrinsics.slice(1, 0, 1).expand([views, pixels]).reshape([n]);
                let footprint = (distance / focal).reshape([n, 1]).expand([n, 3]);
                let scales = footprint * raw_scales.clamp(-3.0, 3.0).exp() * scale;
                let one = self.raw.tape().constant_with([n, 4], |q| {
                    q.iter_mut().step_by(4).for_each(|w| *w = T::ONE);
                });
                let own = (photos.permute(&[0, 2, 3, 1]).reshape([n, 1, 3]) - 0.5) * (1.0 / sh::DC);
                let even = colors.slice(1, 0, 1) + own;
                let colors = ops::concat(&[even, colors.slice(1, 1, COLOR_HARMONICS - 1)], 1);
                (distance, scales, quats + one, colors)
            }
        };
        let distance = distance.reshape([views, pixels, 1]);
        let means = self.rays.points(distance).reshape([n, 3]);
        let gaussians = GaussianVars { means, quats, scales, opacities: self.opacities().mean(), colors };
        (gaussians, self.rays.depth(distance))
    }

    /// The Gaussians' opacities as functions of the view direction.
    #[track_caller]
    pub fn opacities(&self) -> Opacities<'t, T> {
        Opacities::of_raw(self.raw.slice(1, OPACITY, self.opacity.numbers()))
    }
}
