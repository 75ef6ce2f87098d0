//! The loss of one step: what is computed for a stage's tuples, and its terms by name.

use crate::batch::{Batch, pose_code, rotation_row, translation_row};
use crate::{BudgetForm, Cameras, StageConfig};
use smallvec::SmallVec;
use weaver_autograd::{List, Shape, Var};
use weaver_kernels::random::Stream;
use weaver_losses as losses;
use weaver_losses::Lpips;
use weaver_model::{Dense, PredictedGaussians, SplatWeaver};
use weaver_nn::Context;
use weaver_pose::Cameras as CameraVars;
use weaver_router::Allocation;
use weaver_scene::{intrinsics_row, viewmat};
use weaver_splat::{CameraVars as RasterCameras, RasterSettings, Rasterize, WorkspacePool};
use weaver_vggt::Encoded;

/// How many terms there are at most.
const MOST_TERMS: usize = 12;

/// One loss: a sum over tuples, of which each counts `share`.
#[derive(Debug)]
struct Term<'t> {
    name: &'static str,
    weight: f64,
    share: f64,
    sum: Var<'t, f32>,
}

/// The terms of a loss.
#[derive(Debug, Default)]
pub struct Terms<'t> {
    terms: SmallVec<[Term<'t>; MOST_TERMS]>,
    /// Gaussians per context pixel.
    pub gaussians_per_pixel: f32,
}

impl<'t> Terms<'t> {
    /// Adds one tuple's loss, which counts `share` in the mean, unless its weight is 0; `value` is not computed then.
    fn add(&mut self, name: &'static str, weight: f64, share: f64, value: impl FnOnce() -> Var<'t, f32>) {
        if weight != 0.0 {
            let value = value();
            match self.terms.iter_mut().find(|term| term.name == name) {
                Some(term) => term.sum = term.sum + value,
                None => self.terms.push(Term { name, weight, share, sum: value }),
            }
        }
    }

    /// The weighted sum; `None` without terms.
    pub fn total(&self) -> Option<Var<'t, f32>> {
        self.terms.iter().map(|term| term.sum * (term.weight * term.share)).reduce(|a, b| a + b)
    }

    /// Names and means over the tuples, before weights.
    pub fn values(&self) -> impl Iterator<Item = (&'static str, f32)> {
        self.terms.iter().map(|term| (term.name, term.sum.item() * term.share as f32))
    }
}

/// What a step needs beside its tuples.
#[derive(Debug)]
pub struct Objective<'a> {
    /// The stage.
    pub stage: &'a StageConfig,
    /// Whether the ranking loss is still on.
    pub ranking: bool,
    /// The stage's allocation.
    pub allocation: &'a dyn Allocation<f32>,
    /// LPIPS, where the stage wants it.
    pub lpips: Option<&'a Lpips<f32>>,
    /// Memory of the rasterizer.
    pub workspaces: &'a WorkspacePool<f32>,
    /// Noise of this step.
    pub stream: Stream,
}

impl Objective<'_> {
    /// Runs the model on the step's tuples (those to be rendered first) and collects the loss.
    pub fn terms<'t>(&self, cx: Context<'t, '_, f32>, model: &SplatWeaver, batches: &[Batch]) -> Terms<'t> {
        let config = model.config();
        let (width, height) = (config.width, config.height);
        let views = batches[0].context().len();
        let photos = cx.tape.constant_with([batches.len(), views, 3, height, width], |all| {
            for (photos, batch) in all.chunks_mut(views * 3 * height * width).zip(batches) {
                photos.copy_from_slice(batch.context_images());
            }
        });
        let encoded = model.encode(cx, photos);
        let mut terms = Terms::default();
        self.pose_terms(&mut terms, cx, &encoded, batches);
        for (b, batch) in batches.iter().take(self.stage.tuples).enumerate() {
            self.scene_terms(&mut terms, cx, model, &encoded, b, batch);
        }
        terms
    }

    /// Losses on the cameras of all tuples.
    fn pose_terms<'t>(
        &self,
        terms: &mut Terms<'t>,
        cx: Context<'t, '_, f32>,
        encoded: &Encoded<'t>,
        batches: &[Batch],
    ) {
        let weights = &self.stage.losses;
        let shape = encoded.codes[0].shape();
        let [scenes, views] = [shape[0], shape[1]];
        let truth = || rows(cx, batches.iter().flat_map(|b| b.context()).map(pose_code), shape);
        terms.add("pose", weights.pose, 1.0, || losses::l1_pose(&encoded.codes, truth()));
        terms.add("pose_huber", weights.pose_huber, 1.0, || {
            let truth = truth();
            let teacher: List<_> = encoded.codes.iter().map(|_| truth).collect();
            losses::huber_pose(&encoded.codes, &teacher, 1.0)
        });
        terms.add("pose_absolute", weights.pose_absolute, 1.0, || {
            let poses = || batches.iter().flat_map(|b| &b.absolute);
            let rotations = rows(cx, poses().map(rotation_row), [scenes, views, 3, 3]);
            let translations = rows(cx, poses().map(translation_row), [scenes, views, 3]);
            let own_rotations: List<_> =
                encoded.raw.iter().map(|c| weaver_pose::rotation_from_xyzw(c.slice(2, 3, 4))).collect();
            let own_translations: List<_> = encoded.raw.iter().map(|c| c.slice(2, 0, 3)).collect();
            losses::absolute_pose(&own_rotations, &own_translations, rotations, translations)
        });
    }

    /// Losses on depth, renders and routing of one tuple; each is a mean over the stage's tuples.
    fn scene_terms<'t>(
        &self,
        terms: &mut Terms<'t>,
        cx: Context<'t, '_, f32>,
        model: &SplatWeaver,
        encoded: &Encoded<'t>,
        b: usize,
        batch: &Batch,
    ) {
        let weights = &self.stage.losses;
        let share = 1.0 / self.stage.tuples as f64;
        let config = model.config();
        let (width, height, views) = (config.width, config.height, batch.context().len());
        let photos = cx.tape.constant(batch.context_images(), [views, 3, height, width]);
        let dense = model.dense(cx, encoded, b, photos);
        let known = cx.tape.constant(&batch.depth, dense.depth.shape());
        terms.add("depth", weights.depth, share, || losses::sparse_log_depth_l1(dense.depth.ln(), known, 1.0));

        let cameras = match self.stage.cameras {
            Cameras::Predicted => encoded.scene_cameras(b),
            Cameras::Given => given(cx, batch.context()),
        };
        let stream = self.stream.fork(b as u64);
        let predicted = model.gaussians(cx, &dense, photos, &cameras, self.allocation, stream);
        terms.gaussians_per_pixel +=
            (predicted.assignment.count() as f64 * share / (views * height * width) as f64) as f32;

        let shown = if self.stage.render_targets { batch.cameras.len() } else { views };
        let rendered = self.render(cx, model, &predicted, &cameras, batch);
        let image = rendered.image.permute(&[0, 3, 1, 2]).clamp(0.0, 1.0);
        let truth = cx.tape.constant(&batch.images[..shown * 3 * height * width], image.shape());
        terms.add("mse", weights.mse, share, || losses::mse(image, truth));
        terms.add("ssim", weights.ssim, share, || (losses::ssim(image, truth).mean() * -1.0 + 1.0) * 0.5);
        if let Some(lpips) = self.lpips {
            terms.add("lpips", weights.lpips, share, || lpips.distance(image, truth).mean());
        }
        terms.add("rendered_depth", weights.rendered_depth, share, || {
            let own = rendered.depth.slice(0, 0, views);
            // There is no teacher that doubts: what is near is trusted most, what is unknown not at all.
            let confidence = batch.depth.iter().map(|d| [if *d > 0.0 { 1.0 / d } else { 0.0 }]);
            losses::masked_depth_mse(own, known, rows(cx, confidence, known.shape()), 0.3)
        });
        self.routing_terms(terms, cx, share, &dense, &predicted, image.slice(0, 0, views), photos);
    }

    fn render<'t>(
        &self,
        cx: Context<'t, '_, f32>,
        model: &SplatWeaver,
        predicted: &PredictedGaussians<'t>,
        cameras: &CameraVars<'t>,
        batch: &Batch,
    ) -> weaver_splat::RenderedVars<'t, f32> {
        let config = model.config();
        // Intrinsics are held constant in the rasterizer, as in gsplat; the field of view learns through the
        // unprojection.
        let mut w2c = cameras.w2c;
        let mut intrinsics = cameras.intrinsics.detach();
        if self.stage.render_targets {
            let targets = given(cx, batch.targets());
            w2c = weaver_autograd::ops::concat(&[w2c, targets.w2c], 0);
            intrinsics = weaver_autograd::ops::concat(&[intrinsics, targets.intrinsics], 0);
        }
        let background = cx.tape.constant(&config.raster.background.map(|c| c as f32), [3]);
        let settings = RasterSettings {
            near: config.raster.near,
            alpha_max: config.raster.alpha_max,
            ..RasterSettings::default()
        };
        let op = Rasterize::new(config.width, config.height, settings, self.workspaces);
        let op = if self.stage.losses.rendered_depth == 0.0 { op.without_depth() } else { op };
        op.apply(&predicted.gaussians, &RasterCameras { viewmats: w2c, intrinsics, background })
    }

    fn routing_terms<'t>(
        &self,
        terms: &mut Terms<'t>,
        cx: Context<'t, '_, f32>,
        share: f64,
        dense: &Dense<'t>,
        predicted: &PredictedGaussians<'t>,
        own: Var<'t, f32>,
        photos: Var<'t, f32>,
    ) {
        let weights = &self.stage.losses;
        if self.ranking {
            terms.add("rank", weights.rank, share, || {
                losses::ranking_cross_entropy(
                    dense.logits,
                    dense.energy,
                    &weights.rank_quantiles,
                    weights.label_smoothing,
                )
            });
        }
        if let Some(choice) = predicted.choice {
            terms.add("budget", weights.budget, share, || {
                let shares = match weights.budget_form {
                    BudgetForm::Shares => true,
                    BudgetForm::Limit => false,
                    BudgetForm::SharesThenLimit => self.ranking,
                };
                if shares {
                    losses::share_budget(choice, &weights.budget_shares)
                } else {
                    losses::global_budget(choice, weights.budget_limit)
                }
            });
        }
        terms.add("error_regression", weights.error_regression, share, || {
            let score = dense.logits.slice(1, 1, 1) - dense.logits.slice(1, 0, 1);
            let error = cx.tape.without_gradient(|| (own.detach() - photos).square().mean_axis(1));
            losses::error_regression(score.reshape(error.shape()), error.detach())
        });
    }
}

/// The data's cameras as constants.
fn given<'t>(cx: Context<'t, '_, f32>, cameras: &[weaver_geometry::Camera]) -> CameraVars<'t> {
    CameraVars {
        w2c: rows(cx, cameras.iter().map(|c| viewmat(&c.pose)), [cameras.len(), 3, 4]),
        intrinsics: rows(cx, cameras.iter().map(intrinsics_row), [cameras.len(), 4]),
    }
}

/// A constant made row by row.
fn rows<'t, const N: usize>(
    cx: Context<'t, '_, f32>,
    rows: impl Iterator<Item = [f32; N]>,
    shape: impl Into<Shape>,
) -> Var<'t, f32> {
    cx.tape.constant_with(shape, |all| all.chunks_exact_mut(N).zip(rows).for_each(|(to, row)| to.copy_from_slice(&row)))
}
