//! The guidance mask, which passes pixel features to the router where the image has detail.

use weaver_autograd::{Real, Var};
use weaver_nn::{Builder, Context, Conv2d, WeightInit};
use weaver_wavelet::{Wavelet, analysis, luma};

/// Turns the wavelet detail bands of images into a mask with one factor per pixel and feature.
///
/// Parameters: `wave_merger1.0` (conv 5x5), `wave_merger1.1` (conv 1x1, no activation between), `wave_merger2.0` (conv
/// 3x3), each `weight` and `bias`, drawn as PyTorch does.
#[derive(Clone, Copy, Debug)]
pub struct Guidance {
    wavelet: Wavelet,
    gather: Conv2d,
    mix: Conv2d,
    spread: Conv2d,
}

impl Guidance {
    /// Adds the parameters of a module with `hidden` channels at the resolution of the sub-bands and a mask for
    /// `features` channels.
    pub fn new<T: Real>(builder: &mut Builder<'_, T>, wavelet: Wavelet, hidden: usize, features: usize) -> Self {
        let mut conv = |name, inputs, outputs, kernel| {
            Conv2d::new(builder.scope(name), inputs, outputs, kernel, WeightInit::FanIn)
        };
        Self {
            wavelet,
            gather: conv("wave_merger1.0", 3, hidden, 5),
            mix: conv("wave_merger1.1", hidden, hidden, 1),
            spread: conv("wave_merger2.0", hidden, features, 3),
        }
    }

    /// The mask A of images with values in [0, 1], with factors in (0, 1).
    ///
    /// A = sigmoid(conv3x3(resize(conv1x1(conv5x5(D))))), where D are the three signed detail bands of the luma,
    /// neither squared nor normalized, and the resize to H x W is bilinear, corners not aligned. Images `[V, 3, H, W]`
    /// give `[V, F, H, W]`. Differentiable in the parameters and in the images. Source: `SplatWeaver_Head` of the
    /// official code.
    #[track_caller]
    pub fn forward<'t, T: Real>(&self, cx: Context<'t, '_, T>, images: Var<'t, T>) -> Var<'t, T> {
        let bands = analysis(luma(images), self.wavelet);
        let details = bands.slice(1, 1, 3);
        let hidden = self.mix.forward(cx, self.gather.forward(cx, details));
        let [height, width] = [images.shape()[2], images.shape()[3]];
        self.spread.forward(cx, hidden.bilinear(height, width, false)).sigmoid()
    }
}
