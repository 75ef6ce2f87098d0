//! The network that reads poses off camera tokens.

use smallvec::SmallVec;
use weaver_autograd::{Outputs, ParamId, Real, Var, ops};
use weaver_nn::{Block, BlockConfig, Builder, Context, Init, LayerNorm, Linear, WeightInit};
use weaver_pose::code::LENGTH;
use weaver_pose::{activate, first_camera_gauge};

/// Sizes and initial values of a [`CameraHead`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CameraHeadConfig {
    /// Width of a camera token.
    pub dim: usize,
    /// Blocks of the trunk.
    pub depth: usize,
    /// Attention heads.
    pub heads: usize,
    /// Hidden width of a block's perceptron over `dim`.
    pub mlp_ratio: usize,
    /// Refinements, all with the same weights.
    pub iterations: usize,
    /// Initial weights of linear layers.
    pub weight: WeightInit,
    /// Initial values of the learned first code.
    pub token: Init,
    /// LayerScale of the trunk.
    pub layer_scale: f64,
    /// The field of view in radians, both ways, of the code that the first increment is added to; its rotation is the
    /// identity. Without it the first increment is the first code, as published: fields of view then start at 0, where
    /// they have no gradient.
    pub base_fov: Option<f64>,
    /// True if poses are emitted relative to the scene's first camera ([`first_camera_gauge`]). Without it they are
    /// emitted in the frame of the network's own choice, as published weights expect.
    pub relative: bool,
}

/// The result of one refinement.
#[derive(Clone, Copy, Debug)]
pub struct PoseEstimate<'t, T: Real = f32> {
    /// The running code `[B, V, 9]` in the frame of the network's own choice: quaternion of any length, field of view
    /// not rectified.
    pub raw: Var<'t, T>,
    /// The emitted code `[B, V, 9]` in the configured frame, field of view rectified.
    pub code: Var<'t, T>,
}

impl<T: Real> Outputs<T> for PoseEstimate<'_, T> {
    fn for_each_var(&self, visit: &mut dyn FnMut(Var<'_, T>)) {
        [self.raw, self.code].for_each_var(visit);
    }
}

/// VGGT's camera head (Wang et al. 2025, arXiv 2503.11651): a pose code per view, refined step by step.
///
/// Each step modulates the camera tokens by the code so far, lets the views attend to one another, and adds an
/// increment. The code so far is held constant within a step, so each step's gradient stays in that step.
#[derive(Clone, Debug)]
pub struct CameraHead {
    config: CameraHeadConfig,
    token_norm: LayerNorm,
    empty_pose_tokens: ParamId,
    embed_pose: Linear,
    modulation: Linear,
    trunk: Vec<Block>,
    trunk_norm: LayerNorm,
    pose_branch: [Linear; 2],
}

impl CameraHead {
    /// Builds `token_norm`, `empty_pose_tokens`, `embed_pose`, `poseLN_modulation.1`, `trunk.{i}`, `trunk_norm` and
    /// `pose_branch.fc1`, `pose_branch.fc2`.
    pub fn new<T: Real>(mut b: Builder<'_, T>, config: CameraHeadConfig) -> Self {
        let CameraHeadConfig { dim, weight, .. } = config;
        let block = BlockConfig {
            width: dim,
            heads: config.heads,
            hidden: config.mlp_ratio * dim,
            eps: 1e-5,
            layer_scale: Some(config.layer_scale),
            qk_norm: false,
            init: weight,
        };
        Self {
            config,
            token_norm: LayerNorm::new(b.scope("token_norm"), dim, 1e-5),
            empty_pose_tokens: b.add("empty_pose_tokens", [1, 1, LENGTH], config.token),
            embed_pose: Linear::new(b.scope("embed_pose"), LENGTH, dim, weight),
            modulation: Linear::new(b.scope("poseLN_modulation.1"), dim, 3 * dim, weight),
            trunk: (0..config.depth).map(|i| Block::new(b.scope(format_args!("trunk.{i}")), &block)).collect(),
            trunk_norm: LayerNorm::new(b.scope("trunk_norm"), dim, 1e-5),
            pose_branch: [
                Linear::new(b.scope("pose_branch.fc1"), dim, dim / 2, weight),
                Linear::new(b.scope("pose_branch.fc2"), dim / 2, LENGTH, weight),
            ],
        }
    }

    /// Pose codes of camera tokens `[B, V, dim]`, one estimate per refinement; the last is the best.
    pub fn forward<'t, T: Real>(
        &self,
        cx: Context<'t, '_, T>,
        tokens: Var<'t, T>,
    ) -> SmallVec<[PoseEstimate<'t, T>; 4]> {
        let [scenes, views] = [tokens.shape()[0], tokens.shape()[1]];
        let tokens = self.token_norm.forward(cx, tokens);
        let normalized = tokens.layer_norm(None, 1e-6);
        let mut code = self.config.base_fov.map(|fov| self.base(cx, scenes, views, fov));
        let mut estimates: SmallVec<[PoseEstimate<'t, T>; 4]> = SmallVec::new();
        for _ in 0..self.config.iterations {
            let seen = match estimates.last() {
                Some(estimate) => estimate.raw.detach(),
                None => cx.param(self.empty_pose_tokens).expand([scenes, views, LENGTH]),
            };
            let increment = self.increment(cx, tokens, normalized, seen);
            let raw = match code {
                Some(code) => code + increment,
                None => increment,
            };
            code = Some(raw.detach());
            let activated = activate(raw);
            let emitted = if self.config.relative { first_camera_gauge(activated) } else { activated };
            estimates.push(PoseEstimate { raw, code: emitted });
        }
        estimates
    }

    fn increment<'t, T: Real>(
        &self,
        cx: Context<'t, '_, T>,
        tokens: Var<'t, T>,
        normalized: Var<'t, T>,
        code: Var<'t, T>,
    ) -> Var<'t, T> {
        let dim = self.config.dim;
        let modulated = || {
            let modulation = self.modulation.forward(cx, self.embed_pose.forward(cx, code).silu());
            let parts = ops::split(modulation, 2, &[dim, dim, dim]);
            let (shift, scale, gate) = (parts[0], parts[1], parts[2]);
            tokens + gate * (normalized * (scale + 1.0) + shift)
        };
        let blocks = self.trunk.iter().enumerate();
        let run = |x, (i, block): (usize, &Block)| cx.part(format_args!("trunk.{i}"), || block.forward(cx, x, None));
        let [fc1, fc2] = &self.pose_branch;
        cx.tape
            .steps(|| cx.tape.fold(modulated, blocks, run))
            .then(|x| fc2.forward(cx, fc1.forward(cx, self.trunk_norm.forward(cx, x)).gelu()))
            .end()
    }

    /// The code of cameras at the origin with this field of view.
    fn base<'t, T: Real>(&self, cx: Context<'t, '_, T>, scenes: usize, views: usize, fov: f64) -> Var<'t, T> {
        cx.tape.constant_with([scenes, views, LENGTH], |codes| {
            for code in codes.chunks_mut(LENGTH) {
                code[6] = T::ONE;
                code[7..].fill(T::from_f64(fov));
            }
        })
    }
}
