//! Correction of depth where the views agree on another.

use crate::StereoConfig;
use weaver_autograd::{Real, Var, ops};
use weaver_nn::{Builder, Context, Conv2d, WeightInit};
use weaver_pose::{CameraVars, plane_sweep};

/// Compares views at multiples of each pixel's depth, and moves it to where they agree.
///
/// depth' = depth exp(sum over k of p_k ln s_k), with factors s_k in equal ratios from 1 / reach to reach, and p the
/// softmax of three convolutions of the [agreements](plane_sweep) and the log depth. The features that are compared are
/// two convolutions of photos and expert features. It starts without effect.
///
/// Parameters: `compare.0`, `compare.1`, `judge.0`, `judge.1`, `judge.2`, each `weight` and `bias`.
#[derive(Clone, Debug)]
pub struct Stereo {
    compare: [Conv2d; 2],
    judge: [Conv2d; 3],
    factors: Vec<f64>,
}

impl Stereo {
    /// Adds the parameters, for so many channels of expert features.
    pub fn new<T: Real>(builder: &mut Builder<'_, T>, sizes: StereoConfig, features: usize) -> Self {
        let StereoConfig { channels, hidden, depths, reach } = sizes;
        let mut conv = |name, inputs, outputs, init| Conv2d::new(builder.scope(name), inputs, outputs, 3, init);
        let step = 2.0 * reach.ln() / (depths - 1) as f64;
        Self {
            compare: [
                conv("compare.0", 3 + features, hidden, WeightInit::FanIn),
                conv("compare.1", hidden, channels, WeightInit::FanIn),
            ],
            judge: [
                conv("judge.0", depths + 1, hidden, WeightInit::FanIn),
                conv("judge.1", hidden, hidden, WeightInit::FanIn),
                conv("judge.2", hidden, depths, WeightInit::Zero),
            ],
            factors: (0..depths).map(|k| (k as f64 * step - reach.ln()).exp()).collect(),
        }
    }

    /// The corrected depth `[V, H, W]` of photos `[V, 3, H, W]` with expert features as rows `[P, C]`. Differentiable
    /// in all inputs but the cameras, and in the parameters; the depths at which views are compared are constant.
    pub fn forward<'t, T: Real>(
        &self,
        cx: Context<'t, '_, T>,
        photos: Var<'t, T>,
        features: Var<'t, T>,
        depth: Var<'t, T>,
        cameras: &CameraVars<'t, T>,
        pixel_offset: f64,
    ) -> Var<'t, T> {
        let [views, height, width] = [depth.shape()[0], depth.shape()[1], depth.shape()[2]];
        let channels = features.shape()[1];
        let maps = features.reshape([views, height, width, channels]).permute(&[0, 3, 1, 2]);
        let [first, second] = &self.compare;
        let hidden = first.forward(cx, ops::concat(&[photos, maps], 1)).gelu();
        let compared = second.forward(cx, hidden).permute(&[0, 2, 3, 1]);
        let agreement = plane_sweep(compared, depth, cameras.viewmats, cameras.intrinsics, &self.factors, pixel_offset);
        let log_depth = depth.detach().ln().reshape([views, 1, height, width]);
        let seen = ops::concat(&[agreement.permute(&[0, 3, 1, 2]), log_depth], 1);
        let [first, second, last] = &self.judge;
        let hidden = second.forward(cx, first.forward(cx, seen).gelu()).gelu();
        let share = last.forward(cx, hidden).permute(&[0, 2, 3, 1]).softmax(3);
        let logs: Vec<T> = self.factors.iter().map(|factor| T::from_f64(factor.ln())).collect();
        let logs = cx.tape.constant(&logs, [self.factors.len()]).expand(share.shape());
        depth * (share * logs).sum_axis(3).reshape(depth.shape()).exp()
    }
}
