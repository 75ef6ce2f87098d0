//! SplatWeaver's loss of one step.

use super::SplatWeaverRecipe;
use super::routing::Routed;
use crate::losses::{ImageNetworks, PoseCodes, camera_constants, photo_constants};
use crate::{CameraMode, Example, StageConfig, Terms};
use weaver_kernels::random::Stream;
use weaver_model::{PredictedGaussians, SplatWeaver};
use weaver_nn::Context;
use weaver_pose::CameraVars;
use weaver_router::{Allocation, Masked};
use weaver_splat::{Rasterize, WorkspacePool};
use weaver_vggt::Encoded;

/// Inputs of a step beside its tuples.
#[derive(Debug)]
pub struct Objective<'a> {
    /// The stage.
    pub stage: &'a StageConfig<SplatWeaverRecipe>,
    /// True if the ranking loss is still on.
    pub ranking: bool,
    /// The stage's allocation.
    pub allocation: &'a dyn Allocation<f32>,
    /// Networks that compare images, where the stage has such losses.
    pub networks: &'a ImageNetworks,
    /// Memory of the rasterizer.
    pub workspaces: &'a WorkspacePool<f32>,
    /// Noise of this step.
    pub stream: Stream,
}

impl Objective<'_> {
    /// Runs the model on the step's examples (examples to be rendered come first) and collects the loss.
    pub fn terms<'t>(&self, cx: Context<'t, '_, f32>, model: &SplatWeaver, examples: &[Example]) -> Terms<'t> {
        let encoded = model.encode(cx, photo_constants(cx, examples));
        let mut terms = Terms::default();
        let codes = PoseCodes { cameras: encoded.cameras, emitted: &encoded.codes, raw: &encoded.raw };
        self.stage.losses.pose.add(&mut terms, cx, codes, examples);
        for (b, example) in examples.iter().take(self.stage.tuples).enumerate() {
            self.scene_terms(&mut terms, cx, model, (&encoded, b), example);
        }
        terms
    }

    /// Losses on depth, renders and routing of example `b`; each is a mean over the stage's tuples.
    fn scene_terms<'t>(
        &self,
        terms: &mut Terms<'t>,
        cx: Context<'t, '_, f32>,
        model: &SplatWeaver,
        (encoded, b): (&Encoded<'t>, usize),
        example: &Example,
    ) {
        let weights = &self.stage.losses;
        let share = 1.0 / self.stage.tuples as f64;
        let config = model.config();
        let (width, height, views) = (config.width, config.height, example.context().len());
        let photos = cx.tape.constant(example.context_photos().planes, [views, 3, height, width]);
        let dense = model.dense(cx, encoded, b, photos);
        let known = cx.tape.constant(&example.depth, dense.depth.shape());
        weights.depth.add_predicted(terms, share, dense.depth, known);

        let cameras = match self.stage.model.cameras {
            CameraMode::Predicted => encoded.scene_cameras(b),
            CameraMode::Given => camera_constants(cx, example.context()),
        };
        let stream = self.stream.fork(b as u64);
        let allocation = Masked { among: self.allocation, inside: example.inside_of(views) };
        let predicted = model.gaussians(cx, &dense, photos, &cameras, &allocation, stream);
        if model.config().dense.stereo.is_some() {
            weights.depth.add_predicted(terms, share, predicted.depth, known);
        }
        terms.gaussians_per_pixel +=
            (predicted.assignment.count() as f64 * share / (views * height * width) as f64) as f32;

        let shown = if self.stage.model.render_targets { example.cameras.len() } else { views };
        let rendered = self.render(cx, model, &predicted, &cameras, example);
        let image = rendered.image.permute(&[0, 3, 1, 2]).clamp(0.0, 1.0);
        let truth = cx.tape.constant(&example.images[..shown * 3 * height * width], image.shape());
        weights.image.add(terms, share, self.networks, [image, truth], example.inside_of(shown));
        weights.depth.add_rendered(terms, cx, share, || rendered.depth, example);
        let routed = Routed {
            logits: dense.logits,
            energy: dense.energy,
            choice: predicted.choice,
            own: image.slice(0, 0, views),
            photos,
            inside: example.inside_of(views),
        };
        weights.router.add(terms, share, self.ranking, &routed);
    }

    fn render<'t>(
        &self,
        cx: Context<'t, '_, f32>,
        model: &SplatWeaver,
        predicted: &PredictedGaussians<'t>,
        cameras: &CameraVars<'t>,
        example: &Example,
    ) -> weaver_splat::RenderedVars<'t, f32> {
        let config = model.config();
        // Intrinsics are held constant in the rasterizer, as in gsplat; the field of view learns through the
        // unprojection.
        let mut viewmats = cameras.viewmats;
        let mut intrinsics = cameras.intrinsics.detach();
        if self.stage.model.render_targets {
            let targets = camera_constants(cx, example.targets());
            viewmats = weaver_autograd::ops::concat(&[viewmats, targets.viewmats], 0);
            intrinsics = weaver_autograd::ops::concat(&[intrinsics, targets.intrinsics], 0);
        }
        let background = cx.tape.constant(&config.raster.background.map(|c| c as f32), [3]);
        let settings = config.raster.settings();
        let op = Rasterize::new(config.width, config.height, settings, self.workspaces);
        let op = if self.stage.losses.depth.rendered == 0.0 { op.without_depth() } else { op };
        op.apply(&predicted.gaussians, &CameraVars { viewmats, intrinsics }, background)
    }
}
