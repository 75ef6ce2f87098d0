//! Alternatives to the mixture's router: a perceptron on pixels, and one number for each Gaussian of the merged scene.

use weaver_autograd::ops;
use weaver_autograd::{ParamId, Real, Var};
use weaver_dynamic::Shot;
use weaver_nn::{Builder, Context, Init, Linear, WeightInit};
use weaver_pose::Rays;
use weaver_splat::{GaussianVars, Rasterize};

/// The pixel router of MoE-GS's comparison: G = softmax of a perceptron on (u, t, ray, I_1 .. I_K) at each pixel, where
/// u is the pixel's center in [-1, 1]^2, t the time, the ray a unit vector, and I_k the color of expert k. Relu between
/// three layers. Its inputs are the pictures, without their Gaussians. The widths are ours.
#[derive(Clone, Copy, Debug)]
pub struct MlpRouter {
    layers: [Linear; 3],
    experts: usize,
}

/// A gate and its mixture of pictures, P = H W pixels.
#[derive(Clone, Copy, Debug)]
pub struct Blended<'t, T: Real = f32> {
    /// The gate `[K, P]`; sums to 1 over the experts.
    pub gate: Var<'t, T>,
    /// The mixture, sum_k G_k I_k `[P, 3]`.
    pub image: Var<'t, T>,
}

impl MlpRouter {
    /// Builds the layers `0`, `1` and `2`: 6 + 3 K numbers to `width`, to `width`, to K.
    ///
    /// ```
    /// use weaver_autograd::Params;
    /// use weaver_nn::Builder;
    /// use weaver_studies::alternatives::MlpRouter;
    /// let mut params = Params::<f32>::new();
    /// MlpRouter::new(Builder::new(&mut params, 0), 2, 64);
    /// assert_eq!(params.count(), 12 * 64 + 64 + 64 * 64 + 64 + 64 * 2 + 2);
    /// ```
    ///
    /// # Panics
    /// If there is no expert.
    pub fn new<T: Real>(mut b: Builder<'_, T>, experts: usize, width: usize) -> Self {
        assert!(experts > 0, "a router has experts");
        let widths = [6 + 3 * experts, width, width, experts];
        let layers = [0, 1, 2].map(|i| Linear::new(b.scope(i), widths[i], widths[i + 1], WeightInit::FanIn));
        Self { layers, experts }
    }

    /// Gates the experts' pictures `[K, P, 3]` of a shot. Differentiable in the layers and in the pictures.
    #[track_caller]
    pub fn gated<'t, T: Real>(
        &self,
        cx: Context<'t, '_, T>,
        images: Var<'t, T>,
        shot: &Shot<'_, 't, T>,
    ) -> Blended<'t, T> {
        let ([height, width], experts) = (shot.size, self.experts);
        let pixels = height * width;
        let place = cx.tape.constant_with([pixels, 3], |all| {
            let centered = |i: usize, n: usize| T::from_f64((2 * i + 1) as f64 / n as f64 - 1.0);
            for (i, row) in all.chunks_exact_mut(3).enumerate() {
                row.copy_from_slice(&[centered(i % width, width), centered(i / width, height), T::from_f64(shot.time)]);
            }
        });
        let rays = Rays::new(&shot.camera, shot.size).directions.reshape([pixels, 3]);
        let colors = images.permute(&[1, 0, 2]).reshape([pixels, 3 * experts]);
        let seen = ops::concat(&[place, rays, colors], 1);
        let [first, second, last] = &self.layers;
        let hidden = second.forward(cx, first.forward(cx, seen).relu()).relu();
        let gate = last.forward(cx, hidden).permute(&[1, 0]).softmax(0);
        let shares = gate.reshape([experts, pixels, 1]).expand([experts, pixels, 3]);
        Blended { gate, image: (images * shares).sum_axis(0) }
    }
}

/// The volume router of MoE-GS's comparison: all experts' Gaussians are one scene, each with a number m, and are drawn
/// with opacity times sigmoid(m). Experts hide one another, and nothing depends on time or direction.
#[derive(Clone, Copy, Debug)]
pub struct VolumeRouter {
    logit: ParamId,
}

impl VolumeRouter {
    /// Builds `logit` `[N]`, 0 to begin with: half of each opacity.
    ///
    /// ```
    /// use weaver_autograd::Params;
    /// use weaver_nn::Builder;
    /// use weaver_studies::alternatives::VolumeRouter;
    /// let mut params = Params::<f32>::new();
    /// VolumeRouter::new(Builder::new(&mut params, 0).scope("volume"), 5);
    /// assert_eq!(params.find("volume.logit").map(|id| params.get(id).value()), Some(&[0.0; 5][..]));
    /// ```
    pub fn new<T: Real>(mut b: Builder<'_, T>, gaussians: usize) -> Self {
        Self { logit: b.add("logit", [gaussians], Init::Constant(0.0)) }
    }

    /// The picture `[P, 3]` of the list of all Gaussians at the time of a shot. Differentiable in the numbers and in
    /// the Gaussians.
    #[track_caller]
    pub fn image<'t, T: Real>(
        &self,
        cx: Context<'t, '_, T>,
        gaussians: &GaussianVars<'t, T>,
        shot: &Shot<'_, 't, T>,
    ) -> Var<'t, T> {
        let [height, width] = shot.size;
        let opacities = gaussians.opacities * cx.param(self.logit).sigmoid();
        let op = Rasterize::new(width, height, shot.settings, shot.workspaces).without_depth();
        let drawn = op.apply(&GaussianVars { opacities, ..*gaussians }, &shot.camera, shot.background);
        drawn.image.reshape([height * width, 3])
    }
}
