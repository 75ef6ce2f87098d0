//! The common trait of models of motion.

pub mod code;
pub mod field;
mod heads;
pub mod keys;
pub mod poly;

use std::fmt::Debug;
use weaver_autograd::{ParamId, Real, Var};
use weaver_nn::{Builder, Context, Init};
use weaver_splat::GaussianVars;

/// Gaussians as a function of time.
///
/// Time runs from 0 to 1 over a clip. Outside of it models extrapolate in different ways, without meaning.
pub trait Motion<T: Real>: Debug + Send + Sync {
    /// The Gaussians at a time. Differentiable in all parameters of the model.
    fn at<'t>(&self, cx: Context<'t, '_, T>, time: f64) -> Moved<'t, T>;

    /// The parameters with a row for each Gaussian, for pruning.
    fn rows(&self) -> Vec<ParamId>;

    /// Regularizer added to the loss of pictures, with its published weights; `None` for models without.
    fn regularizer<'t>(&self, _cx: Context<'t, '_, T>) -> Option<Var<'t, T>> {
        None
    }
}

/// N Gaussians at a time, without colors.
#[derive(Clone, Copy, Debug)]
pub struct Moved<'t, T: Real = f32> {
    /// Centers `[N, 3]`.
    pub means: Var<'t, T>,
    /// Unit quaternions `[N, 4]`, wxyz.
    pub quats: Var<'t, T>,
    /// Scales `[N, 3]`, positive.
    pub scales: Var<'t, T>,
    /// Opacities `[N]`, 0 to 1.
    pub opacities: Var<'t, T>,
}

impl<'t, T: Real> Moved<'t, T> {
    /// The Gaussians with colors `[N, 3]` or `[N, K, 3]`.
    pub fn with_colors(&self, colors: Var<'t, T>) -> GaussianVars<'t, T> {
        let Self { means, quats, scales, opacities } = *self;
        GaussianVars { means, quats, scales, opacities, colors }
    }

    /// Raw numbers as Gaussians: means as they are, scales exp, quaternions at unit length, opacities sigmoid.
    /// Opacities are `[N, 1]`.
    pub(crate) fn activated([means, scales, quats, opacities]: [Var<'t, T>; 4]) -> Self {
        let n = means.shape()[0];
        Self {
            means,
            quats: quats.normalize_rows(0.0),
            scales: scales.exp(),
            opacities: opacities.reshape([n]).sigmoid(),
        }
    }
}

/// The initial Gaussians of a model.
#[derive(Clone, Copy, Debug)]
pub struct Start<'a> {
    /// Centers `[N, 3]`.
    pub positions: &'a [f64],
    /// Standard deviations `[N]`, positive: the distance to the nearest neighbor is usual.
    pub sizes: &'a [f64],
    /// Opacity of all of them, above 0 and below 1: 0.1 is usual.
    pub opacity: f64,
}

impl Start<'_> {
    /// Number of Gaussians.
    pub fn count(&self) -> usize {
        self.sizes.len()
    }
}

/// Raw mean, log scale, quaternion and logit of opacity of each Gaussian.
#[derive(Clone, Copy, Debug)]
pub(crate) struct RawGaussians([ParamId; 4]);

impl RawGaussians {
    /// Builds `mean` `[N, 3]`, `scale` `[N, 3]`, `quat` `[N, 4]` and `opacity` `[N, 1]`.
    ///
    /// # Panics
    /// Unless there are three coordinates for each size.
    pub fn new<T: Real>(b: &mut Builder<'_, T>, start: &Start<'_>) -> Self {
        let n = start.count();
        assert_eq!(start.positions.len(), 3 * n, "three coordinates for each of {n} sizes");
        let all = [("mean", 3), ("scale", 3), ("quat", 4), ("opacity", 1)]
            .map(|(name, width)| b.add(name, [n, width], Init::Constant(0.0)));
        let fill = |b: &mut Builder<'_, T>, id, value: &dyn Fn(usize) -> f64| {
            b.value_mut(id).iter_mut().enumerate().for_each(|(i, x)| *x = T::from_f64(value(i)));
        };
        fill(b, all[0], &|i| start.positions[i]);
        fill(b, all[1], &|i| start.sizes[i / 3].ln());
        fill(b, all[2], &|i| if i % 4 == 0 { 1.0 } else { 0.0 });
        fill(b, all[3], &|_| logit(start.opacity));
        Self(all)
    }

    /// Mean, scale, quaternion, opacity.
    pub fn vars<'t, T: Real>(&self, cx: Context<'t, '_, T>) -> [Var<'t, T>; 4] {
        self.0.map(|id| cx.param(id))
    }

    /// All four.
    pub fn ids(&self) -> Vec<ParamId> {
        self.0.to_vec()
    }

    /// Mean.
    pub fn mean(&self) -> ParamId {
        self.0[0]
    }
}

pub(crate) fn logit(p: f64) -> f64 {
    (p / (1.0 - p)).ln()
}
