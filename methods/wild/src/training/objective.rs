//! WildSplatter's loss of one step.

use super::WildRecipe;
use super::frame::KnownDepth;
use super::sections::Runs;
use crate::Wild;
use weaver_autograd::Var;
use weaver_losses as losses;
use weaver_nn::Context;
use weaver_pose::CameraVars;
use weaver_procedural::appearance::keep_columns;
use weaver_splat::Rasterize;
use weaver_trainer::losses::{PoseCodes, camera_constants, photo_constant, photo_constants};
use weaver_trainer::{CameraMode, Example, StageConfig, Step, Terms};

/// Fails if no loss has a weight, or if alignment is on with given cameras.
pub(super) fn check(stage: &StageConfig<WildRecipe>, key: &str) -> Result<(), String> {
    if stage.model.aligned && stage.model.cameras == CameraMode::Given {
        return Err(format!("{key}.model.aligned: expected model.cameras = \"predicted\" with it, found \"given\""));
    }
    if stage.renders() || stage.losses.pose.sum() + stage.losses.depth > 0.0 {
        return Ok(());
    }
    Err(format!("{key}.losses: expected a loss with a weight above 0, found none"))
}

/// Runs the network on a step's examples.
pub(super) fn terms<'t>(
    cx: Context<'t, '_, f32>,
    network: &Wild,
    step: &Step<'_, WildRecipe>,
    examples: &[Example],
) -> Terms<'t> {
    let stage = step.stage;
    let mut terms = Terms::default();
    let encoded = network.encode(cx, photo_constants(cx, examples));
    let codes = PoseCodes { cameras: encoded.cameras, emitted: &encoded.codes, raw: &encoded.raw };
    stage.losses.pose.add(&mut terms, cx, codes, examples);
    if stage.losses.depth == 0.0 && !stage.renders() {
        return terms;
    }
    let share = 1.0 / examples.len() as f64;
    let size = [network.config().height, network.config().width];
    for (b, example) in examples.iter().enumerate() {
        let views = example.context().len();
        let depth = network.depth(cx, &encoded, b, views, size);
        terms.add("depth", stage.losses.depth, share, || {
            let known = cx.tape.constant(&example.depth, depth.shape());
            losses::sparse_log_depth_l1(depth.ln(), known, 1.0)
        });
        if !stage.renders() {
            continue;
        }
        let cameras = match stage.model.cameras {
            CameraMode::Predicted => encoded.scene_cameras(b),
            CameraMode::Given => camera_constants(cx, example.context()),
        };
        let (photos, inside) = (photo_constant(cx, example.context_photos()), example.inside_of(views));
        let mut surface = network.surface(cx, (&encoded, b), photos, inside, depth, &cameras);
        if stage.model.aligned {
            let points =
                weaver_pose::unproject(depth.detach(), cameras.viewmats.detach(), cameras.intrinsics.detach(), 0.5);
            let known = KnownDepth { depth: &example.depth, cameras: example.context() };
            let Some(frame) = known.frame(&points.value()) else { continue };
            surface = surface.placed(frame.scale, frame.translation);
        }
        let targets = photo_constant(cx, example.photos()).slice(0, views, example.targets().len());
        let looks = if stage.model.embed {
            network.embed(cx, light_photos(cx, step, targets, b))
        } else {
            network.no_look(cx).expand([example.targets().len(), network.config().looks.embedding])
        };
        let colors = network.colors(cx, &surface, looks);
        let [n, k] = [1, 2].map(|axis| colors.shape()[axis]);
        for t in 0..example.targets().len() {
            let all = surface.with_colors(colors.slice(0, t, 1).reshape([n, k, 3]));
            let shown = inside.map_or(all, |inside| all.kept(inside));
            terms.gaussians_per_pixel +=
                (share * shown.opacities.shape()[0] as f64 / (n * example.targets().len()) as f64) as f32;
            rendered(&mut terms, cx, step, example, t, (&shown, targets.slice(0, t, 1)), share);
        }
    }
    terms
}

/// The photos `[T, 3, H, W]` of tuple `b` as inputs of the embedding: some with one half in place of the whole.
fn light_photos<'t>(
    cx: Context<'t, '_, f32>,
    step: &Step<'_, WildRecipe>,
    photos: Var<'t, f32>,
    b: usize,
) -> Var<'t, f32> {
    let fraction = step.stage.model.halves;
    if fraction == 0.0 {
        return photos;
    }
    let (shape, stream) = (photos.shape(), step.stream.fork(b as u64));
    let (width, half) = (shape[3], shape[3] / 2);
    let mut all = photos.to_vec();
    for (t, photo) in all.chunks_mut(3 * shape[2] * width).enumerate() {
        let drawn = stream.fork(t as u64);
        if drawn.uniform::<f64>(0) >= fraction {
            continue;
        }
        let left = drawn.uniform::<f64>(1) < 0.5;
        for plane in photo.chunks_mut(shape[2] * width) {
            keep_columns(plane, width, if left { 0..half } else { half..width });
        }
    }
    cx.tape.constant(&all, shape)
}

/// Losses on the picture of an example's target `t` against its photo `[1, 3, H, W]`, each a mean over tuples and
/// targets.
fn rendered<'t>(
    terms: &mut Terms<'t>,
    cx: Context<'t, '_, f32>,
    step: &Step<'_, WildRecipe>,
    example: &Example,
    t: usize,
    (gaussians, truth): (&weaver_splat::GaussianVars<'t, f32>, Var<'t, f32>),
    share: f64,
) {
    let config = &step.config.model;
    let camera: CameraVars<'t> = camera_constants(cx, &example.targets()[t..=t]);
    let background = cx.tape.constant(&config.raster.background.map(|c| c as f32), [3]);
    let op = Rasterize::new(config.width, config.height, config.raster.settings(), step.workspaces).without_depth();
    let image = op.apply(gaussians, &camera, background).image.permute(&[0, 3, 1, 2]).clamp(0.0, 1.0);
    let pixels = config.width * config.height;
    let all = vec![true; pixels];
    let first = (example.context().len() + t) * pixels;
    let inside = example.inside.as_ref().map_or(&all[..], |inside| &inside[first..][..pixels]);
    let weights = &step.stage.losses.image;
    let share = share / example.targets().len() as f64;
    terms.add("mse", weights.mse, share, || losses::masked_mse(image, truth, inside));
    terms.add("ssim", weights.ssim, share, || (losses::masked_ssim(image, truth, inside).mean() * -1.0 + 1.0) * 0.5);
    let seen = || [image, truth].map(|image| losses::inside_of(image, inside));
    if let Some(lpips) = &step.networks.lpips {
        terms.add("lpips", weights.lpips, share, || {
            let [image, truth] = seen();
            lpips.distance(image, truth).mean()
        });
    }
    if let Some(perceptual) = &step.networks.perceptual {
        terms.add("perceptual", weights.perceptual, share, || {
            let [image, truth] = seen();
            perceptual.loss(image, truth)
        });
    }
}
