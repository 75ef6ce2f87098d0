//! A model of motion with colors.

use crate::Motion;
use weaver_autograd::{ParamId, Real};
use weaver_nn::{Builder, Context, Init};
use weaver_splat::GaussianVars;

/// A complete dynamic scene: a motion, and one color for each Gaussian, the same at all times and from all sides.
#[derive(Debug)]
pub struct Expert<T: Real> {
    motion: Box<dyn Motion<T>>,
    color: ParamId,
}

impl<T: Real> Expert<T> {
    /// Builds `color` `[N, 3]` beside the parameters of a motion, from colors `[N, 3]` in [0, 1].
    pub fn new(mut b: Builder<'_, T>, motion: impl Motion<T> + 'static, colors: &[f64]) -> Self {
        let color = b.add("color", [colors.len() / 3, 3], Init::Constant(0.0));
        b.value_mut(color).iter_mut().zip(colors).for_each(|(to, x)| *to = T::from_f64(*x));
        Self { motion: Box::new(motion), color }
    }

    /// The motion.
    pub fn motion(&self) -> &dyn Motion<T> {
        &*self.motion
    }

    /// The parameters with a row for each Gaussian.
    pub fn rows(&self) -> Vec<ParamId> {
        [self.motion.rows(), vec![self.color]].concat()
    }

    /// The parameter of the colors `[N, 3]`.
    pub fn color(&self) -> ParamId {
        self.color
    }

    /// The Gaussians at a time, 0 to 1.
    pub fn at<'t>(&self, cx: Context<'t, '_, T>, time: f64) -> GaussianVars<'t, T> {
        self.motion.at(cx, time).with_colors(cx.param(self.color))
    }
}
