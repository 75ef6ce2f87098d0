//! The photo network's loss of one step.

use super::{PhotoLosses, PhotoRecipe};
use crate::losses::{camera_constants, photo_constant};
use crate::splatweaver::routing::Routed;
use crate::{Error, Example, StageConfig, Step, Terms};
use weaver_geometry::Camera;
use weaver_losses::laplacian_log_depth;
use weaver_nn::Context;
use weaver_photo::{Comparison, FAR, PhotoNetwork, Prior};
use weaver_router::Allocation;
use weaver_splat::Rasterize;

/// Fails if a stage has no loss, an allocation that the network does not have, or a budget loss without a choice.
pub(super) fn check(stage: &StageConfig<PhotoRecipe>, experts: usize, key: &str) -> Result<(), String> {
    let PhotoLosses { image, l1, depth, router } = &stage.losses;
    let allocation = stage.model.allocation.allocation(stage.model.dense, stage.model.budget, &[1.0], experts);
    allocation.map_err(|e| format!("{key}.model.allocation: {e}"))?;
    let most = experts - 1;
    for (name, list) in [("rank_quantiles", &router.rank_quantiles), ("budget_shares", &router.budget_shares)] {
        if list.len() != most {
            let expected = format!("expected {most} numbers, one for each expert from E_1 on");
            return Err(format!("{key}.losses.router.{name}: {expected}, found {list:?}"));
        }
    }
    if router.budget > 0.0 && !stage.model.allocation.is_routed() {
        let expected = "expected 0 but with the allocations sampled and argmax, where the router chooses";
        return Err(format!("{key}.losses.router.budget: {expected}, found {}", router.budget));
    }
    if image.weights().iter().map(|(_, weight)| weight).sum::<f64>() + l1 + depth > 0.0 {
        return Ok(());
    }
    Err(format!("{key}.losses: expected a loss on pictures or depth with a weight above 0, found none"))
}

/// Runs the network on a step's examples.
pub(super) fn terms<'t>(
    cx: Context<'t, '_, f32>,
    network: &PhotoNetwork,
    step: &Step<'_, PhotoRecipe>,
    examples: &[Example],
) -> Result<Terms<'t>, Error> {
    let settings = &step.stage.model;
    let experts = network.config().gaussians.experts();
    let allocation = settings.allocation.allocation(settings.dense, settings.budget, &BUDGETS, experts)?;
    let mut terms = Terms::default();
    for (b, example) in examples.iter().enumerate() {
        scene_terms(&mut terms, cx, network, step, (b, example), &*allocation);
    }
    Ok(terms)
}

/// Gaussians per pixel, one of which `mix` draws.
const BUDGETS: [f64; 3] = [0.25, 0.5, 1.0];

/// Losses on depth, renders and routing of an example; each is a mean over the stage's tuples.
fn scene_terms<'t>(
    terms: &mut Terms<'t>,
    cx: Context<'t, '_, f32>,
    network: &PhotoNetwork,
    step: &Step<'_, PhotoRecipe>,
    (b, example): (usize, &Example),
    allocation: &dyn Allocation<f32>,
) {
    let (weights, share) = (&step.stage.losses, 1.0 / step.stage.tuples as f64);
    let (stream, photos) = (step.stream.fork(b as u64), example.context_photos());
    let comparison = Comparison::simulated(photos, example.context(), &example.depth, stream.fork(0));
    let prior = Prior::new(photos, example.context(), &comparison);
    let colors = photo_constant(cx, photos);
    let dense = network.dense(cx, &prior, colors);
    terms.add("depth", weights.depth, share, || {
        let far = |z: f32| if z > 0.0 { (z / prior.scale as f32).clamp(1.0 / FAR, FAR) } else { FAR };
        let truth: Vec<f32> = example.depth.iter().map(|z| far(*z)).collect();
        laplacian_log_depth(dense.log_depth, dense.log_spread, cx.tape.constant(&truth, dense.log_depth.shape()))
    });
    let inside = example.inside_of(prior.views());
    let made = network.gaussians(cx, (&dense, &prior), colors, inside, allocation, stream.fork(1));
    let pixels = example.depth.len() as f64;
    terms.gaussians_per_pixel += (made.assignment.count() as f64 * share / pixels) as f32;

    let unit = 1.0 / prior.scale;
    let scaled = |camera: &Camera| Camera { pose: camera.pose.scaled(unit), ..*camera };
    let cameras: Vec<Camera> = example.cameras.iter().map(scaled).collect();
    let config = network.config();
    let background = cx.tape.constant(&config.raster.background.map(|c| c as f32), [3]);
    let op = Rasterize::new(photos.width, photos.height, config.raster.settings(), step.workspaces).without_depth();
    let rendered = op.apply(&made.gaussians, &camera_constants(cx, &cameras), background);
    let image = rendered.image.permute(&[0, 3, 1, 2]).clamp(0.0, 1.0);
    let truth = photo_constant(cx, example.photos());
    weights.image.add(terms, share, step.networks, [image, truth], example.inside_of(cameras.len()));
    terms.add("l1", weights.l1, share, || (image - truth).abs().mean());
    let ranking = (step.local as f64) < weights.router.rank_until * step.stage.steps as f64;
    let routed = Routed {
        logits: dense.logits,
        energy: dense.energy,
        choice: made.choice,
        own: image.slice(0, 0, prior.views()),
        photos: colors,
        inside,
    };
    weights.router.add(terms, share, ranking, &routed);
}
