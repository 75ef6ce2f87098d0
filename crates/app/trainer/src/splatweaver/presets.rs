//! The presets: their stages, with steps and losses.

use super::{EvaluationSettings, Losses, RouterLosses, SplatWeaverRecipe, StageAllocation, StageSettings};
use crate::losses::{DepthLosses, ImageLosses, PoseLosses};
use crate::{CameraMode, Config, OptimizerConfig, OutputConfig, Recipe, StageConfig};
use weaver_model::ModelConfig;
use weaver_router::{AllocationKind, TrainingMix};

pub(super) fn preset(name: &str) -> Option<Config<SplatWeaverRecipe>> {
    if !SplatWeaverRecipe::PRESETS.contains(&name) {
        return None;
    }
    let model = ModelConfig::preset(match name {
        "tiny-dagger" => "tiny-published",
        name => name,
    })?;
    let evaluation = EvaluationSettings {
        cameras: CameraMode::Predicted,
        allocation: Some(AllocationKind::Dithered),
        budget: Some(0.4),
    };
    let mut config = Config::new(name, model, vec![poses(1300), everything(4000)], evaluation);
    match name {
        "micro" => {
            config.data.context_views = 2;
            config.data.pool = 4;
            config.stages = vec![poses(10), everything(40)];
            config.output = OutputConfig { log_every: 5, checkpoint_every: 25, sample_every: 25 };
        }
        "tiny-endless" => {
            config.data.endless = Some(2);
            // An average over a thousand of the 40 000 steps.
            config.optimizer.ema = Some(0.999);
            config.stages = vec![given(40_000)];
            config.evaluation.cameras = CameraMode::Given;
            config.output = OutputConfig { log_every: 100, checkpoint_every: 1000, sample_every: 10_000 };
        }
        "tiny-published" | "tiny-dagger" => {
            config.optimizer =
                OptimizerConfig { beta2: 0.95, weight_decay: 0.05, clip: 0.5, ema: None, ..config.optimizer };
            config.stages = vec![published(1500)];
            if name == "tiny-dagger" {
                few(&mut config.stages[0].losses.router);
            }
            config.evaluation.allocation = Some(AllocationKind::Sampled);
        }
        "generalist" => {
            let even = AllocationKind::Fixed(1);
            config.stages = vec![with_pairs(poses(1300)), appearance(3000), joint(2000)];
            config.stages.iter_mut().for_each(|stage| {
                (stage.model.allocation, stage.model.dense) = (StageAllocation::Kind(even), 0.0);
                stage.losses.router = one_expert(&stage.losses.router);
            });
            (config.evaluation.allocation, config.evaluation.budget) = (Some(even), None);
        }
        "small" | "medium" => {
            config.stages = vec![given(4000)];
            config.stages[0].model.allocation = StageAllocation::QuadtreeMix;
            config.evaluation = EvaluationSettings {
                cameras: CameraMode::Given,
                allocation: Some(AllocationKind::Quadtree),
                budget: Some(0.3),
            };
            if name == "medium" {
                let cells = config.stages[0].clone();
                config.stages.push(experts(cells, 200));
            }
        }
        _ => {}
    }
    Some(config)
}

/// A third of the Gaussians, by rank as by budget. The paper names such a variant without its construction.
fn few(router: &mut RouterLosses) {
    router.rank_quantiles = vec![0.9175, 0.9875, 0.995];
    router.budget_shares = vec![0.07, 0.0075, 0.005];
    router.budget_limit = 0.1;
}

/// Poses alone: without it the renderer learns before the cameras do, and stays blurred.
fn poses(steps: usize) -> StageConfig<SplatWeaverRecipe> {
    StageConfig {
        name: "poses".into(),
        steps,
        tuples: 0,
        rate: 5e-4,
        warmup: 100,
        floor: 0.4,
        frozen: Vec::new(),
        recompute: false,
        model: StageSettings {
            pose_tuples: 4,
            backbone_rate: 1.0,
            allocation: StageAllocation::Mix,
            dense: 1.0 / 16.0,
            budget: 0.4,
            budgets: TrainingMix::default().budgets,
            cameras: CameraMode::Predicted,
            render_targets: false,
        },
        losses: Losses { pose: PoseLosses { l1: 2.0, absolute: 1.0, ..PoseLosses::default() }, ..Losses::default() },
    }
}

/// Everything together.
fn everything(steps: usize) -> StageConfig<SplatWeaverRecipe> {
    let poses = poses(steps);
    StageConfig {
        name: "everything".into(),
        steps,
        tuples: 1,
        rate: 1e-3,
        warmup: 100,
        floor: 0.05,
        frozen: Vec::new(),
        recompute: false,
        model: StageSettings { pose_tuples: 1, backbone_rate: 0.3, render_targets: true, ..poses.model },
        losses: Losses {
            image: ImageLosses { mse: 1.0, ssim: 0.15, ..ImageLosses::default() },
            depth: DepthLosses { log_l1: 0.2, ..DepthLosses::default() },
            router: RouterLosses { error_regression: 0.02, ..RouterLosses::default() },
            ..poses.losses
        },
    }
}

/// With 2Xplat's losses on the cameras of pairs.
fn with_pairs(stage: StageConfig<SplatWeaverRecipe>) -> StageConfig<SplatWeaverRecipe> {
    let pairs = PoseLosses::relative(stage.losses.pose.absolute);
    StageConfig { losses: Losses { pose: pairs, ..stage.losses }, ..stage }
}

/// The router's losses for a single expert.
fn one_expert(router: &RouterLosses) -> RouterLosses {
    RouterLosses {
        rank_quantiles: router.rank_quantiles[..1].to_vec(),
        budget_shares: router.budget_shares[..1].to_vec(),
        error_regression: 0.0,
        ..router.clone()
    }
}

/// Training like 2Xplat's appearance expert, from given cameras and pictures alone; here the backbone must keep its
/// ability to predict cameras.
fn appearance(steps: usize) -> StageConfig<SplatWeaverRecipe> {
    let everything = everything(steps);
    StageConfig {
        name: "appearance".into(),
        floor: 0.1,
        model: StageSettings { cameras: CameraMode::Given, ..everything.model },
        losses: Losses { pose: PoseLosses::relative(1.0), depth: DepthLosses::default(), ..everything.losses },
        ..everything
    }
}

/// Training like 2Xplat's two experts, which learn through each other.
fn joint(steps: usize) -> StageConfig<SplatWeaverRecipe> {
    let appearance = appearance(steps);
    StageConfig {
        name: "joint".into(),
        rate: 3e-4,
        floor: 0.05,
        model: StageSettings { cameras: CameraMode::Predicted, ..appearance.model },
        ..appearance
    }
}

/// Depth and appearance from given cameras, which then need no stage of their own.
fn given(steps: usize) -> StageConfig<SplatWeaverRecipe> {
    let everything = everything(steps);
    StageConfig {
        name: "given".into(),
        warmup: 500,
        model: StageSettings { pose_tuples: 0, cameras: CameraMode::Given, ..everything.model },
        losses: Losses {
            // Without a loss on poses the camera head would have no gradients.
            pose: PoseLosses { l1: 0.2, ..PoseLosses::default() },
            ..everything.losses
        },
        ..everything
    }
}

/// The same with equal counts in three steps of ten: most cells get one Gaussian, so that the first expert has learned
/// more than the others.
fn experts(stage: StageConfig<SplatWeaverRecipe>, steps: usize) -> StageConfig<SplatWeaverRecipe> {
    StageConfig {
        name: "experts".into(),
        steps,
        rate: 3e-4,
        warmup: 20,
        model: StageSettings { dense: 0.3, ..stage.model },
        ..stage
    }
}

/// The published losses and allocation at this size, from random weights.
fn published(steps: usize) -> StageConfig<SplatWeaverRecipe> {
    StageConfig {
        name: "published".into(),
        steps,
        tuples: 1,
        rate: 1e-3,
        warmup: 75,
        floor: 0.1,
        frozen: Vec::new(),
        recompute: false,
        model: StageSettings {
            pose_tuples: 0,
            allocation: StageAllocation::Kind(AllocationKind::Sampled),
            dense: 0.0,
            ..poses(steps).model
        },
        losses: Losses {
            image: ImageLosses { mse: 1.0, ssim: 0.15, ..ImageLosses::default() },
            pose: PoseLosses { huber: 10.0, ..PoseLosses::default() },
            depth: DepthLosses { rendered: 0.1, ..DepthLosses::default() },
            router: RouterLosses { rank: 0.01, budget: 0.01, ..RouterLosses::default() },
        },
    }
}
