//! The presets: stages, durations and losses.

use super::{TwoExpertsEvaluation, TwoExpertsLosses, TwoExpertsRecipe, TwoExpertsStage};
use crate::TwoExpertsConfig;
use weaver_trainer::losses::{ImageLosses, PoseLosses};
use weaver_trainer::{CameraMode, Config, OutputConfig, StageConfig};

type Stage = StageConfig<TwoExpertsRecipe>;

pub(super) fn preset(name: &str) -> Option<Config<TwoExpertsRecipe>> {
    let model = TwoExpertsConfig::preset(name)?;
    let stages = vec![poses(1300), appearance(3000), joint(2000)];
    let evaluation = TwoExpertsEvaluation { cameras: CameraMode::Predicted };
    let mut config = Config::new(name, model, stages, evaluation);
    if name == "micro" {
        config.data.context_views = 2;
        config.data.pool = 4;
        config.stages = vec![poses(10), appearance(20), joint(20)];
        config.output = OutputConfig { log_every: 5, checkpoint_every: 25, sample_every: 25 };
    }
    Some(config)
}

/// The geometry expert alone.
fn poses(steps: usize) -> Stage {
    Stage {
        name: "poses".into(),
        steps,
        tuples: 0,
        rate: 5e-4,
        warmup: 100,
        floor: 0.4,
        frozen: Vec::new(),
        recompute: false,
        model: TwoExpertsStage { pose_tuples: 4, geometry_rate: 1.0, cameras: CameraMode::Given },
        losses: TwoExpertsLosses { pose: PoseLosses::relative(1.0), ..TwoExpertsLosses::default() },
    }
}

/// The appearance expert alone, with the data's cameras.
fn appearance(steps: usize) -> Stage {
    Stage {
        name: "appearance".into(),
        steps,
        tuples: 1,
        rate: 1e-3,
        warmup: 100,
        floor: 0.1,
        model: TwoExpertsStage { pose_tuples: 0, ..poses(steps).model },
        losses: TwoExpertsLosses {
            image: ImageLosses { mse: 1.0, ssim: 0.15, ..ImageLosses::default() },
            pose: PoseLosses::default(),
            opacity: 0.001,
        },
        ..poses(steps)
    }
}

/// Both, with pictures drawn from the cameras of the geometry expert.
fn joint(steps: usize) -> Stage {
    Stage {
        name: "joint".into(),
        steps,
        rate: 3e-4,
        floor: 0.05,
        model: TwoExpertsStage { pose_tuples: 1, geometry_rate: 1.0 / 3.0, cameras: CameraMode::Predicted },
        losses: TwoExpertsLosses { pose: PoseLosses::relative(0.0), ..appearance(steps).losses },
        ..appearance(steps)
    }
}
