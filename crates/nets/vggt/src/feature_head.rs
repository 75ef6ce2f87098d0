//! Features of every pixel, from which Gaussians are made.

use crate::dpt::{DenseTokens, DptConfig, DptHead};
use crate::position::add_position;
use weaver_autograd::{Outputs, Real, Var};
use weaver_nn::{Builder, Context, Conv2d, WeightInit};

/// Sizes of a [`FeatureHead`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct FeatureHeadConfig {
    /// The trunk; its `width` is the width of both outputs.
    pub dpt: DptConfig,
    /// Channels between the two convolutions that look at the image itself; none without them.
    pub merger: Option<usize>,
}

/// The outputs of a [`FeatureHead`]: two maps `[N, width, H, W]`.
#[derive(Clone, Copy, Debug)]
pub struct PixelFeatures<'t, T: Real = f32> {
    /// E: the trunk's maps plus the image's own features plus positions.
    pub embedding: Var<'t, T>,
    /// F = relu(conv(E)).
    pub features: Var<'t, T>,
}

impl<T: Real> Outputs<T> for PixelFeatures<'_, T> {
    fn for_each_var(&self, visit: &mut dyn FnMut(Var<'_, T>)) {
        [self.embedding, self.features].for_each_var(visit);
    }
}

/// A dense head whose maps also see the image at full resolution, past the patches (SplatWeaver, arXiv 2605.07287).
#[derive(Clone, Debug)]
pub struct FeatureHead {
    trunk: DptHead,
    merger: Option<[Conv2d; 2]>,
    last: Conv2d,
}

impl FeatureHead {
    /// Builds the trunk, `input_merger.0` and `input_merger.2` if it looks at the image, and `scratch.output_conv2.0`.
    pub fn new<T: Real>(mut b: Builder<'_, T>, config: FeatureHeadConfig) -> Self {
        let width = config.dpt.width;
        let init = WeightInit::FanIn;
        Self {
            trunk: DptHead::new(&mut b, config.dpt),
            merger: config.merger.map(|hidden| {
                [
                    Conv2d::new(b.scope("input_merger.0"), 3, hidden, 7, init),
                    Conv2d::new(b.scope("input_merger.2"), hidden, width, 5, init),
                ]
            }),
            last: Conv2d::new(b.scope("scratch.output_conv2.0"), width, width, 3, init),
        }
    }

    /// The part that turns tokens into maps.
    pub fn trunk(&self) -> &DptHead {
        &self.trunk
    }

    /// Runs on tokens and their images `[.., 3, H, W]` in `[0, 1]` (not normalized), which a head that does not look at
    /// them ignores.
    pub fn forward<'t, T: Real>(
        &self,
        cx: Context<'t, '_, T>,
        tokens: DenseTokens<'_, 't, T>,
        images: Var<'t, T>,
    ) -> PixelFeatures<'t, T> {
        let [height, width] = tokens.image;
        let embed = || {
            let maps = self.trunk.forward(cx, tokens);
            let Some([first, second]) = &self.merger else { return add_position(maps, height, width) };
            let images = images.reshape([maps.shape()[0], 3, height, width]);
            let seen = cx.part("input_merger", || second.forward(cx, first.forward(cx, images).relu()).relu());
            add_position(maps + seen, height, width)
        };
        let features = |embedding| cx.part("scratch.output_conv2", || self.last.forward(cx, embedding).relu());
        cx.tape.steps(embed).then(|embedding| PixelFeatures { embedding, features: features(embedding) }).end()
    }
}
