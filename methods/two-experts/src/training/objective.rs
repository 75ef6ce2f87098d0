//! 2Xplat's loss of one step.

use super::TwoExpertsRecipe;
use super::sections::Runs;
use crate::TwoExperts;
use weaver_autograd::{List, Var, ops};
use weaver_kernels::random::Stream;
use weaver_nn::Context;
use weaver_pose::CameraVars;
use weaver_splat::{GaussianVars, Rasterize};
use weaver_trainer::losses::{PoseCodes, camera_constants, photo_constant};
use weaver_trainer::{CameraMode, Example, StageConfig, Step, Terms};

/// Fails if a stage without rendered tuples has a weight on a loss of pictures, or if no loss has a weight.
pub(super) fn check(stage: &StageConfig<TwoExpertsRecipe>, key: &str) -> Result<(), String> {
    let (image, pose) = (&stage.losses.image, &stage.losses.pose);
    let [mse, ssim, lpips, perceptual] = image.weights();
    let rendered = [mse, ssim, lpips, perceptual, ("opacity", stage.losses.opacity)];
    if stage.tuples == 0
        && let Some((name, weight)) = rendered.iter().find(|(_, weight)| *weight > 0.0)
    {
        return Err(format!("{key}.losses.{name}: expected 0 in a stage without rendered tuples, found {weight}"));
    }
    if rendered.iter().any(|(_, weight)| *weight > 0.0) || pose.sum() > 0.0 {
        return Ok(());
    }
    Err(format!("{key}.losses: expected a loss with a weight above 0, found none"))
}

/// Runs the experts on a step's examples; the rendered ones come first.
pub(super) fn terms<'t>(
    cx: Context<'t, '_, f32>,
    network: &TwoExperts,
    step: &Step<'_, TwoExpertsRecipe>,
    examples: &[Example],
) -> Terms<'t> {
    let stage = step.stage;
    let mut terms = Terms::default();
    let encoded = stage.runs_geometry().then(|| network.cameras(cx, photos(cx, stage, examples)));
    if let Some(encoded) = &encoded {
        let codes = PoseCodes { cameras: encoded.cameras, emitted: &encoded.codes, raw: &encoded.raw };
        stage.losses.pose.add(&mut terms, cx, codes, examples);
    }
    for (b, example) in examples.iter().take(stage.tuples).enumerate() {
        let cameras = match (stage.model.cameras, &encoded) {
            (CameraMode::Predicted, Some(encoded)) => encoded.scene_cameras(b),
            _ => camera_constants(cx, &example.cameras),
        };
        rendered(&mut terms, cx, network, step, (b, example), &cameras);
    }
    terms
}

/// The geometry expert's photos `[B, N, 3, H, W]`: the targets' are among them when targets are drawn from predicted
/// cameras.
fn photos<'t>(cx: Context<'t, '_, f32>, stage: &StageConfig<TwoExpertsRecipe>, examples: &[Example]) -> Var<'t, f32> {
    let all = stage.tuples > 0 && stage.model.cameras == CameraMode::Predicted;
    let of = |example: &Example| photo_constant(cx, if all { example.photos() } else { example.context_photos() });
    let photos: List<_> = examples.iter().map(of).collect();
    let shape = photos[0].shape();
    let joined = ops::concat(&photos, 0);
    joined.reshape([examples.len(), shape[0], shape[1], shape[2], shape[3]])
}

/// Losses on the pictures of an example from `cameras`, context first; each is a mean over the stage's tuples.
fn rendered<'t>(
    terms: &mut Terms<'t>,
    cx: Context<'t, '_, f32>,
    network: &TwoExperts,
    step: &Step<'_, TwoExpertsRecipe>,
    (b, example): (usize, &Example),
    cameras: &CameraVars<'t>,
) {
    let (stage, views) = (step.stage, example.context().len());
    let share = 1.0 / stage.tuples as f64;
    let made = network.gaussians(cx, photo_constant(cx, example.context_photos()), &cameras.slice(0, views));
    let all = made.gaussians.opacities.shape()[0];
    let made = example.inside_of(views).map_or(made, |inside| made.kept(inside));
    let kept = made.gaussians.opacities.shape()[0];
    terms.gaussians_per_pixel += (share * kept as f64 / all as f64) as f32;
    let config = network.config();
    // Intrinsics are held constant in the rasterizer, as in gsplat; they learn through rays and footprints.
    let shown = CameraVars { viewmats: cameras.viewmats, intrinsics: cameras.intrinsics.detach() };
    let background = cx.tape.constant(&config.raster.background.map(|c| c as f32), [3]);
    let draw = |gaussians: &GaussianVars<'t, f32>, cameras: &CameraVars<'t>| {
        let op = Rasterize::new(config.width, config.height, config.raster.settings(), step.workspaces).without_depth();
        op.apply(gaussians, cameras, background).image
    };
    let images = if made.opacities.depend_on_view() {
        let centers = cameras.centers();
        let seen = |i: usize| draw(&made.seen_from(centers.slice(0, i, 1)), &shown.slice(i, 1));
        let images: List<_> = (0..example.cameras.len()).map(seen).collect();
        ops::concat(&images, 0)
    } else {
        draw(&made.gaussians, &shown)
    };
    let image = images.permute(&[0, 3, 1, 2]).clamp(0.0, 1.0);
    let (truth, inside) = (photo_constant(cx, example.photos()), example.inside_of(example.cameras.len()));
    stage.losses.image.add(terms, share, step.networks, [image, truth], inside);
    terms.add("opacity", stage.losses.opacity, share, || {
        if made.opacities.depend_on_view() {
            made.opacities.along(random_directions(cx, kept, step.stream.fork(b as u64))).mean()
        } else {
            made.gaussians.opacities.mean()
        }
    });
}

/// Unit vectors `[N, 3]`, uniform on the sphere.
fn random_directions<'t>(cx: Context<'t, '_, f32>, n: usize, stream: Stream) -> Var<'t, f32> {
    let normal = cx.tape.constant_with([n, 3], |all| {
        (0..).zip(all).for_each(|(i, x)| *x = stream.normal(i));
    });
    normal.normalize_rows(0.0)
}
