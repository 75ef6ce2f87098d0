//! The presets: stages, durations and losses.

use super::{WildEvaluation, WildLosses, WildRecipe, WildStage};
use crate::WildConfig;
use weaver_trainer::losses::{ImageLosses, PoseLosses};
use weaver_trainer::{CameraMode, Config, LooksConfig, OutputConfig, StageConfig};

type Stage = StageConfig<WildRecipe>;

pub(super) fn preset(name: &str) -> Option<Config<WildRecipe>> {
    let model = WildConfig::preset(name)?;
    let stages = vec![poses(1300), depth(1200), looks(3000)];
    let mut config = Config::new(name, model, stages, WildEvaluation { cameras: CameraMode::Given });
    config.data.looks = Some(LooksConfig::default());
    if name == "micro" {
        config.data.context_views = 2;
        config.data.pool = 4;
        config.stages = vec![poses(10), depth(10), looks(30)];
        config.output = OutputConfig { log_every: 5, checkpoint_every: 25, sample_every: 25 };
    }
    Some(config)
}

/// Backbone and camera head, on photos in different light.
fn poses(steps: usize) -> Stage {
    Stage {
        name: "poses".into(),
        steps,
        tuples: 4,
        rate: 5e-4,
        warmup: 100,
        floor: 0.4,
        frozen: Vec::new(),
        recompute: false,
        model: WildStage { cameras: CameraMode::Given, aligned: false, embed: true, halves: 0.0 },
        losses: WildLosses {
            pose: PoseLosses { l1: 2.0, absolute: 1.0, ..PoseLosses::default() },
            ..WildLosses::default()
        },
    }
}

/// Depth head in addition.
fn depth(steps: usize) -> Stage {
    let poses = poses(steps);
    Stage {
        name: "depth".into(),
        tuples: 2,
        rate: 1e-3,
        floor: 0.1,
        losses: WildLosses { depth: 0.2, ..poses.losses },
        ..poses
    }
}

/// Surfaces and their looks; everything else is frozen.
fn looks(steps: usize) -> Stage {
    Stage {
        name: "looks".into(),
        tuples: 1,
        rate: 1e-3,
        floor: 0.05,
        frozen: ["aggregator", "camera_head", "depth_head"].map(String::from).to_vec(),
        model: WildStage { halves: 0.5, ..poses(steps).model },
        losses: WildLosses {
            image: ImageLosses { mse: 1.0, ssim: 0.15, ..ImageLosses::default() },
            ..WildLosses::default()
        },
        ..poses(steps)
    }
}
