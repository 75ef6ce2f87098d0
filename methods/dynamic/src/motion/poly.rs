//! Spacetime Gaussians (Li et al., CVPR 2024, arXiv 2312.16812): Gaussians with lifetimes on cubic paths.

use super::{Motion, Moved, RawGaussians, Start};
use weaver_autograd::{ParamId, Real, Var, pointwise};
use weaver_nn::{Builder, Context, Init};

/// Initial log of a Gaussian's lifetime.
const WIDTH: f64 = -1.0;

pointwise!(
    /// exp(-(d / e^s)^2): opacity at a distance d in time of a Gaussian with the log width s.
    Lifetime, 2, |d, s| {
        let x = d / s.exp();
        (-x * x).exp()
    }
);

/// Cubic paths: with D = t - c, the mean mu + b1 D + b2 D^2 + b3 D^3, the quaternion q + omega D at unit length, the
/// opacity times exp(-(D / e^s)^2). No gradient reaches c through path and rotation, as published.
#[derive(Clone, Copy, Debug)]
pub struct Poly {
    raw: RawGaussians,
    motion: ParamId,
    spin: ParamId,
    center: ParamId,
    width: ParamId,
}

impl Poly {
    /// Builds the raw Gaussians, `motion` `[N, 3, 3]` (b1, b2, b3), `spin` `[N, 4]`, `center` `[N]` and `width` `[N]`,
    /// without motion at first, with lifetimes around the times `centers` `[N]`.
    ///
    /// # Panics
    /// Unless there is a time for each Gaussian.
    pub fn new<T: Real>(mut b: Builder<'_, T>, start: &Start<'_>, centers: &[f64]) -> Self {
        let n = start.count();
        assert_eq!(centers.len(), n, "a time for each of {n} Gaussians");
        let raw = RawGaussians::new(&mut b, start);
        let motion = b.add("motion", [n, 3, 3], Init::Constant(0.0));
        let spin = b.add("spin", [n, 4], Init::Constant(0.0));
        let center = b.add("center", [n], Init::Constant(0.0));
        b.value_mut(center).iter_mut().zip(centers).for_each(|(to, time)| *to = T::from_f64(*time));
        Self { raw, motion, spin, center, width: b.add("width", [n], Init::Constant(WIDTH)) }
    }
}

impl<T: Real> Motion<T> for Poly {
    fn rows(&self) -> Vec<ParamId> {
        [self.raw.ids(), vec![self.motion, self.spin, self.center, self.width]].concat()
    }

    fn at<'t>(&self, cx: Context<'t, '_, T>, time: f64) -> Moved<'t, T> {
        let [mean, scale, quat, opacity] = self.raw.vars(cx);
        let n = mean.shape()[0];
        let since = cx.param(self.center) * -1.0 + time;
        let fixed = since.detach();
        let motion = cx.param(self.motion);
        let term = |power: usize, of: Var<'t, T>| {
            let spread = of.reshape([n, 1]).expand([n, 3]);
            motion.slice(1, power, 1).reshape([n, 3]) * spread
        };
        let mean = mean + term(0, fixed) + term(1, fixed * fixed) + term(2, fixed * fixed * fixed);
        let quat = quat + cx.param(self.spin) * fixed.reshape([n, 1]).expand([n, 4]);
        let moved = Moved::activated([mean, scale, quat, opacity]);
        let alive = weaver_autograd::apply_pointwise(Lifetime, [since, cx.param(self.width)]);
        Moved { opacities: moved.opacities * alive, ..moved }
    }
}
