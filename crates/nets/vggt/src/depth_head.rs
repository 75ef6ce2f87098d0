//! Depth and confidence of every pixel.

use crate::dpt::{DenseTokens, DptConfig, DptHead};
use crate::position::add_position;
use weaver_autograd::{Outputs, Real, Var};
use weaver_nn::{Builder, Context, Conv2d, WeightInit};

/// Sizes of a [`DepthHead`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DepthHeadConfig {
    /// The trunk.
    pub dpt: DptConfig,
    /// Channels before the last layer.
    pub hidden: usize,
    /// Bounds of the log depth; outside, its gradient vanishes. None in the published model.
    pub log_depth_bounds: Option<(f64, f64)>,
    /// Initial weights of the last layer: with small weights and no bias the initial depth is near 1.
    pub last: WeightInit,
}

/// Prediction of a [`DepthHead`].
#[derive(Clone, Copy, Debug)]
pub struct DepthMaps<'t, T: Real = f32> {
    /// Depth along the optical axis `[N, H, W]`.
    pub depth: Var<'t, T>,
    /// Confidence, at least 1 `[N, H, W]`.
    pub confidence: Var<'t, T>,
}

impl<T: Real> Outputs<T> for DepthMaps<'_, T> {
    fn for_each_var(&self, visit: &mut dyn FnMut(Var<'_, T>)) {
        [self.depth, self.confidence].for_each_var(visit);
    }
}

/// A dense head for depth: exp of one channel, and 1 + exp of another for its confidence.
#[derive(Clone, Debug)]
pub struct DepthHead {
    config: DepthHeadConfig,
    trunk: DptHead,
    hidden: Conv2d,
    last: Conv2d,
}

impl DepthHead {
    /// Builds the trunk, `scratch.output_conv2.0` and `scratch.output_conv2.2`.
    pub fn new<T: Real>(mut b: Builder<'_, T>, config: DepthHeadConfig) -> Self {
        let trunk = DptHead::new(&mut b, config.dpt);
        let fan_in = WeightInit::FanIn;
        let hidden = Conv2d::new(b.scope("scratch.output_conv2.0"), config.dpt.width, config.hidden, 3, fan_in);
        let last = Conv2d::new(b.scope("scratch.output_conv2.2"), config.hidden, 2, 1, config.last);
        Self { config, trunk, hidden, last }
    }

    /// The part that turns tokens into maps.
    pub fn trunk(&self) -> &DptHead {
        &self.trunk
    }

    /// Predicts for the N views that the leading dimensions of the tokens hold.
    pub fn forward<'t, T: Real>(&self, cx: Context<'t, '_, T>, tokens: DenseTokens<'_, 't, T>) -> DepthMaps<'t, T> {
        let [height, width] = tokens.image;
        let maps = |raw: Var<'t, T>| {
            let channel = |c: usize| raw.slice(1, c, 1).reshape([raw.shape()[0], height, width]);
            let log_depth = match self.config.log_depth_bounds {
                Some((lo, hi)) => channel(0).clamp(lo, hi),
                None => channel(0),
            };
            DepthMaps { depth: log_depth.exp(), confidence: channel(1).exp() + 1.0 }
        };
        let output = |x| {
            cx.part("scratch.output_conv2", || {
                cx.tape.steps(|| self.last.forward(cx, self.hidden.forward(cx, x).relu())).then(maps).end()
            })
        };
        cx.tape.steps(|| self.trunk.forward(cx, tokens)).then(|x| add_position(x, height, width)).then(output).end()
    }
}
