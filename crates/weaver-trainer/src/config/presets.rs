//! The presets: what is trained, for how long, with which losses.

use super::{Cameras, Config, DataConfig, EvaluationConfig, LossWeights, OptimizerConfig, OutputConfig, StageConfig};
use weaver_model::ModelConfig;

pub(super) fn preset(name: &str) -> Option<Config> {
    let model = ModelConfig::preset(name)?;
    let mut config = Config {
        preset: name.into(),
        seed: 0,
        threads: 0,
        model,
        data: DataConfig {
            folders: Vec::new(),
            endless: 0,
            scene_scale: 0.0,
            context_views: 4,
            target_views: 2,
            pool: 6,
        },
        optimizer: OptimizerConfig {
            beta1: 0.9,
            beta2: 0.99,
            epsilon: 1e-8,
            weight_decay: 0.02,
            clip: 1.0,
            ema: 0.998,
        },
        stages: vec![poses(1300), everything(4000)],
        output: OutputConfig { log_every: 10, checkpoint_every: 500, sample_every: 500 },
        evaluation: EvaluationConfig { cameras: Cameras::Predicted, allocation: "dithered".into(), budget: 0.4 },
    };
    match name {
        "micro" => {
            config.data.context_views = 2;
            config.data.pool = 4;
            config.stages = vec![poses(10), everything(40)];
            config.output = OutputConfig { log_every: 5, checkpoint_every: 25, sample_every: 25 };
        }
        "tiny-published" => {
            config.optimizer =
                OptimizerConfig { beta2: 0.95, weight_decay: 0.05, clip: 0.5, ema: 0.0, ..config.optimizer };
            config.stages = vec![published(1500)];
            config.evaluation.allocation = "sampled".into();
        }
        "small" => config.stages[1].render_targets = false,
        _ => {}
    }
    Some(config)
}

/// Poses alone: without it the renderer learns before the cameras do, and stays blurred.
fn poses(steps: usize) -> StageConfig {
    StageConfig {
        name: "poses".into(),
        steps,
        tuples: 0,
        pose_tuples: 4,
        rate: 5e-4,
        backbone_rate: 1.0,
        warmup: 100,
        floor: 0.4,
        allocation: "mix".into(),
        budget: 0.4,
        cameras: Cameras::Predicted,
        render_targets: false,
        losses: LossWeights { pose: 2.0, pose_absolute: 1.0, ..LossWeights::default() },
    }
}

/// Everything together.
fn everything(steps: usize) -> StageConfig {
    StageConfig {
        name: "everything".into(),
        steps,
        tuples: 1,
        pose_tuples: 1,
        rate: 1e-3,
        backbone_rate: 0.3,
        warmup: 100,
        floor: 0.05,
        render_targets: true,
        losses: LossWeights {
            mse: 1.0,
            ssim: 0.15,
            pose: 2.0,
            pose_absolute: 1.0,
            depth: 0.2,
            error_regression: 0.02,
            ..LossWeights::default()
        },
        ..poses(steps)
    }
}

/// The published losses and allocation at this size, from random weights.
fn published(steps: usize) -> StageConfig {
    StageConfig {
        name: "published".into(),
        steps,
        tuples: 1,
        pose_tuples: 0,
        rate: 1e-3,
        backbone_rate: 1.0,
        warmup: 75,
        floor: 0.1,
        allocation: "sampled".into(),
        render_targets: false,
        losses: LossWeights {
            mse: 1.0,
            ssim: 0.15,
            pose_huber: 10.0,
            rendered_depth: 0.1,
            rank: 0.01,
            budget: 0.01,
            ..LossWeights::default()
        },
        ..poses(steps)
    }
}
