//! Conditions across SplatWeaver's sections, so that no stage fails when it begins, and no loss is left out silently.

use super::{SplatWeaverRecipe, StageAllocation};
use crate::{Config, StageConfig};
use weaver_router::AllocationKind;

type Check = Result<(), String>;

pub(super) fn stages(config: &Config<SplatWeaverRecipe>) -> Check {
    let gaussians = &config.model.gaussians;
    config.stages.iter().enumerate().try_for_each(|(i, stage)| {
        let key = format!("stages.{i}");
        if let StageAllocation::Kind(kind) = stage.model.allocation {
            allocation(kind, stage.model.budget, gaussians.experts(), &format!("{key}.model.allocation"))?;
        }
        if stage.model.budgets.is_empty() {
            return Err(format!("{key}.model.budgets: expected at least one number to draw, found none"));
        }
        shares(stage, gaussians.max_per_pixel, &key)?;
        losses(stage, &key)
    })
}

pub(super) fn evaluation(config: &Config<SplatWeaverRecipe>) -> Check {
    let e = &config.evaluation;
    let kind = e.allocation.unwrap_or(AllocationKind::Dithered);
    allocation(kind, e.budget.unwrap_or(1.0), config.model.gaussians.experts(), "evaluation.allocation")
}

fn allocation(kind: AllocationKind, budget: f64, experts: usize, key: &str) -> Check {
    kind.allocation::<f32>(budget, experts).map(|_| ()).map_err(|e| format!("{key}: {e}"))
}

fn shares(stage: &StageConfig<SplatWeaverRecipe>, most: usize, key: &str) -> Check {
    let router = &stage.losses.router;
    for (name, list) in [("rank_quantiles", &router.rank_quantiles), ("budget_shares", &router.budget_shares)] {
        if list.len() != most {
            return Err(format!(
                "{key}.losses.router.{name}: expected {most} numbers, one for each expert from E_1 on, found {list:?}"
            ));
        }
    }
    if !router.rank_quantiles.is_sorted() {
        let found = &router.rank_quantiles;
        return Err(format!("{key}.losses.router.rank_quantiles: expected numbers that do not fall, found {found:?}"));
    }
    if router.budget_shares.iter().sum::<f64>() > 1.0 {
        let found = &router.budget_shares;
        return Err(format!("{key}.losses.router.budget_shares: expected at most 1 in all, found {found:?}"));
    }
    Ok(())
}

/// Every loss with a weight exists in the stage, and every step has a loss.
fn losses(stage: &StageConfig<SplatWeaverRecipe>, key: &str) -> Check {
    let (pose, image) = (&stage.losses.pose, &stage.losses.image);
    let (depth, router) = (&stage.losses.depth, &stage.losses.router);
    let [mse, ssim, lpips, perceptual] = image.weights();
    let rendered = [
        mse,
        ssim,
        lpips,
        perceptual,
        ("depth.log_l1", depth.log_l1),
        ("depth.rendered", depth.rendered),
        ("router.rank", router.rank),
        ("router.budget", router.budget),
        ("router.error_regression", router.error_regression),
    ];
    if stage.tuples == 0
        && let Some((name, weight)) = rendered.iter().find(|(_, weight)| *weight > 0.0)
    {
        return Err(format!("{key}.losses.{name}: expected 0 in a stage without rendered tuples, found {weight}"));
    }
    if router.budget > 0.0 && !stage.model.allocation.is_routed() {
        return Err(format!(
            "{key}.losses.router.budget: expected 0 with the allocation {}, in which the router has no choice as it has in \
             sampled and argmax, found {}",
            stage.model.allocation, router.budget
        ));
    }
    let lasts = |(name, weight): &(&str, f64)| *weight > 0.0 && (*name != "router.rank" || router.rank_until >= 1.0);
    if rendered.iter().any(lasts) || pose.sum() > 0.0 {
        return Ok(());
    }
    Err(format!("{key}.losses: expected a loss with a weight above 0 at every step, found none"))
}
