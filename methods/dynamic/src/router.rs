//! The volume-aware pixel router of MoE-GS (Jin et al., ICLR 2026, arXiv 2510.19210, equations 6 to 8): weights of
//! experts, pixel by pixel.

use crate::{Seen, Shot};
use std::sync::Arc;
use weaver_autograd::ops::{self, Activation};
use weaver_autograd::{ParamId, Real, Var};
use weaver_nn::{Builder, Context, Init};
use weaver_pose::{CameraVars, Rays};
use weaver_scene::Groups;
use weaver_splat::{GaussianVars, RasterError, Rasterize, Workspace};

/// Carried numbers of a Gaussian, drawn as features: its weight, and the weights of directions and of time.
const CARRIED: usize = 3;
/// Widths of the perceptron on two drawn numbers, the camera's center and the pixel's ray.
const WIDTHS: [usize; 4] = [8, 6, 3, 1];
/// Initial value of weights and directions.
const START: f64 = 0.9;

/// Settings of drawing and gating experts.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RouterConfig {
    /// Divisor of the gate's logits, positive: one value in training and in use. (The released code trains with 0.01
    /// and shows with 1.)
    pub temperature: f64,
    /// Values of the drawn numbers on an expert's empty pixels: 1 as published.
    pub background_weight: f64,
}

impl Default for RouterConfig {
    fn default() -> Self {
        Self { temperature: 1.0, background_weight: 1.0 }
    }
}

/// The router of K frozen experts, whose Gaussians are one list.
///
/// Every Gaussian carries w, w_dir and w_time. Drawn with the geometry of its expert, [w, w_dir, t w_time] become maps
/// W_k, plus the remaining transmittance times b. R_k = W_k0 + Phi(W_k1, W_k2, camera center, unit ray), where Phi is a
/// perceptron 8-6-3-1 with relu and without bias that all experts share, and the gate is G = softmax_k(R / tau).
#[derive(Clone, Debug)]
pub struct PixelRouter {
    config: RouterConfig,
    base: ParamId,
    time: ParamId,
    phi: [ParamId; 3],
    /// Owner of each Gaussian.
    owners: Arc<[u32]>,
    /// The rows of each expert's Gaussians.
    rows: Vec<Vec<u32>>,
}

/// Maps drawn by a router for one view and one time, P = H W pixels.
#[derive(Clone, Copy, Debug)]
pub struct Gated<'t, T: Real = f32> {
    /// Each expert's picture `[K, P, 3]`.
    pub images: Var<'t, T>,
    /// Alpha of each expert `[K, P]`.
    pub alphas: Var<'t, T>,
    /// The drawn numbers W `[K, P, 3]`.
    pub maps: Var<'t, T>,
    /// The logits R `[K, P]`.
    pub logits: Var<'t, T>,
    /// The gate `[K, P]`; sums to 1 over the experts.
    pub gate: Var<'t, T>,
    /// The mixture, sum_k G_k I_k `[P, 3]`.
    pub image: Var<'t, T>,
}

impl PixelRouter {
    /// Builds `base` `[N, 2]` (w, w_dir), `time` `[N]` and `phi.{0, 1, 2}`; `owners` are the experts of the Gaussians
    /// of the list, 0 to K - 1.
    ///
    /// # Panics
    /// If an expert has no Gaussian, or the temperature is not positive.
    pub fn new<T: Real>(mut b: Builder<'_, T>, owners: &[usize], config: RouterConfig) -> Self {
        assert!(config.temperature > 0.0, "a router's temperature is positive");
        let experts = owners.iter().max().map_or(0, |last| last + 1);
        let of = |expert: usize| (0..).zip(owners).filter(|(_, owner)| **owner == expert).map(|(row, _)| row).collect();
        let rows: Vec<Vec<u32>> = (0..experts).map(of).collect();
        assert!(rows.iter().all(|rows| !rows.is_empty()), "every expert has Gaussians");
        let phi = [0, 1, 2].map(|i| {
            let (from, to) = (WIDTHS[i], WIDTHS[i + 1]);
            b.add(format_args!("phi.{i}"), [to, from], Init::fan_in(from))
        });
        let base = b.add("base", [owners.len(), 2], Init::Constant(START));
        let time = b.add("time", [owners.len()], Init::Constant(0.0));
        Self { config, base, time, phi, owners: owners.iter().map(|owner| *owner as u32).collect(), rows }
    }

    /// The rows of each expert's Gaussians in the list.
    pub fn rows(&self) -> &[Vec<u32>] {
        &self.rows
    }

    /// Draws all experts in one pass, each with its own transmittance (equation 9), and gates them. `gaussians` is the
    /// list at the shot's time.
    ///
    /// Differentiable in the router's parameters and in the Gaussians; pass these [detached](Var::detach) for frozen
    /// experts.
    #[track_caller]
    pub fn gated<'t, T: Real>(
        &self,
        cx: Context<'t, '_, T>,
        gaussians: &GaussianVars<'t, T>,
        shot: &Shot<'_, 't, T>,
    ) -> Gated<'t, T> {
        let [height, width] = shot.size;
        let op = Rasterize::new(width, height, shot.settings, shot.workspaces).without_depth();
        let op = op.in_groups(self.owners.clone(), self.rows.len());
        let carried = self.carried(cx, shot.time);
        let (seen, features) = op.apply_with_features(gaussians, &shot.camera, shot.background, carried);
        self.gate(cx, [seen.image, seen.alpha, features], shot)
    }

    /// Draws all experts once, for [`gated_again`](Self::gated_again).
    ///
    /// # Errors
    /// When the rasterizer refuses.
    pub fn see<T: Real>(
        &self,
        gaussians: &GaussianVars<'_, T>,
        shot: &Shot<'_, '_, T>,
        workspace: &mut Workspace<T>,
    ) -> Result<Seen<T>, RasterError> {
        let groups = Groups { of: &self.owners, count: self.rows.len() };
        Seen::of(gaussians, groups, shot, workspace)
    }

    /// Gates cached [renders](Self::see) of frozen experts at this shot: [`gated`](Self::gated) without drawing, up to
    /// rounding, W by a sparse product. Differentiable in the router's parameters.
    #[track_caller]
    pub fn gated_again<'t, T: Real>(
        &self,
        cx: Context<'t, '_, T>,
        seen: &Seen<T>,
        shot: &Shot<'_, 't, T>,
    ) -> Gated<'t, T> {
        let pixels = seen.alphas.len();
        let images = cx.tape.constant(&seen.images, [pixels, 3]);
        let alphas = cx.tape.constant(&seen.alphas, [pixels]);
        self.gate(cx, [images, alphas, seen.weights.blend(self.carried(cx, shot.time))], shot)
    }

    /// Features that the Gaussians carry at a time `[N, 3]`.
    fn carried<'t, T: Real>(&self, cx: Context<'t, '_, T>, time: f64) -> Var<'t, T> {
        ops::concat(&[cx.param(self.base), cx.param(self.time).reshape([self.owners.len(), 1]) * time], 1)
    }

    /// Gates pictures, given the carried numbers drawn over zeros.
    fn gate<'t, T: Real>(
        &self,
        cx: Context<'t, '_, T>,
        [images, alphas, drawn]: [Var<'t, T>; 3],
        shot: &Shot<'_, 't, T>,
    ) -> Gated<'t, T> {
        let (experts, pixels) = (self.rows.len(), shot.size[0] * shot.size[1]);
        let [images, drawn] = [images, drawn].map(|all| all.reshape([experts, pixels, 3]));
        let alphas = alphas.reshape([experts, pixels]);
        let left = alphas * -self.config.background_weight + self.config.background_weight;
        let maps = drawn + left.reshape([experts, pixels, 1]).expand([experts, pixels, CARRIED]);
        let logits = self.logits(cx, maps, &shot.camera, shot.size);
        let gate = (logits * (1.0 / self.config.temperature)).softmax(0);
        let shares = gate.reshape([experts, pixels, 1]).expand([experts, pixels, 3]);
        let image = (images * shares).sum_axis(0);
        Gated { images, alphas, maps, logits, gate, image }
    }

    /// R `[K, P]` from maps `[K, P, 3]`.
    fn logits<'t, T: Real>(
        &self,
        cx: Context<'t, '_, T>,
        maps: Var<'t, T>,
        camera: &CameraVars<'t, T>,
        size: [usize; 2],
    ) -> Var<'t, T> {
        let [experts, pixels] = [0, 1].map(|axis| maps.shape()[axis]);
        let rays = Rays::new(camera, size);
        let center = rays.origins.reshape([1, 1, 3]).expand([experts, pixels, 3]);
        let directions = rays.directions.reshape([1, pixels, 3]).expand([experts, pixels, 3]);
        let seen = ops::concat(&[maps.slice(2, 1, 2), center, directions], 2);
        let [first, second, last] = self.phi.map(|id| cx.param(id));
        let x = ops::linear(seen, first, None, Activation::None).relu();
        let x = ops::linear(x, second, None, Activation::None).relu();
        let said = ops::linear(x, last, None, Activation::None).reshape([experts, pixels]);
        maps.slice(2, 0, 1).reshape([experts, pixels]) + said
    }

    /// The parameter of w and w_dir `[N, 2]`.
    pub fn base(&self) -> ParamId {
        self.base
    }

    /// The parameter of w_time `[N]`.
    pub fn time(&self) -> ParamId {
        self.time
    }
}

/// The loss of pictures `[P, 3]` of `size` (H, W): 0.8 mean |a - b| + 0.2 (1 - SSIM), SSIM over windows around every
/// pixel, zeros outside.
///
/// Differentiable in both.
#[track_caller]
pub fn photometric<'t, T: Real>(a: Var<'t, T>, b: Var<'t, T>, [height, width]: [usize; 2]) -> Var<'t, T> {
    let planes = |image: Var<'t, T>| image.reshape([1, height, width, 3]).permute(&[0, 3, 1, 2]);
    let similarity = weaver_losses::ssim_zero_padded(planes(a), planes(b)).mean();
    (a - b).abs().mean() * 0.8 + (similarity * -1.0 + 1.0) * 0.2
}

/// Distillation into one expert (equation 11): lambda L(G I_k, G I) + (1 - lambda) L((1 - G) I_k, (1 - G) I_mix), the
/// gate G `[P]` and the mixture held constant. Lambda is not published; 0.5 is ours.
///
/// Pictures are `[P, 3]` of `size` (H, W). Differentiable in `expert`.
#[track_caller]
pub fn distillation<'t, T: Real>(
    expert: Var<'t, T>,
    gate: Var<'t, T>,
    [photo, mixture]: [Var<'t, T>; 2],
    lambda: f64,
    size: [usize; 2],
) -> Var<'t, T> {
    let pixels = gate.shape().len();
    let own = gate.detach().reshape([pixels, 1]).expand([pixels, 3]);
    let others = own * -1.0 + 1.0;
    let by_photo = photometric(own * expert, own * photo, size);
    let by_mixture = photometric(others * expert, others * mixture.detach(), size);
    by_photo * lambda + by_mixture * (1.0 - lambda)
}
