//! The presets: one network in three sizes of photos, a run each, begun with the weights of the one before.

use super::{PhotoEvaluation, PhotoLosses, PhotoRecipe, PhotoStage};
use crate::losses::ImageLosses;
use crate::splatweaver::{RouterLosses, StageAllocation};
use crate::{Config, OutputConfig, StageConfig};
use weaver_photo::PhotoConfig;

pub(super) fn preset(name: &str) -> Option<Config<PhotoRecipe>> {
    let model = PhotoConfig::preset(name)?;
    let (steps, rate) = match name {
        "photo-128" => (6000, 5e-4),
        "photo-192" => (4000, 3e-4),
        "micro" => (40, 1e-3),
        _ => (8000, 1e-3),
    };
    let evaluation = PhotoEvaluation { allocation: "quadtree".into(), budget: Some(0.5) };
    let mut config = Config::new(name, model, vec![drawn(steps, rate)], evaluation);
    config.data.endless = Some(2);
    config.data.context_views = 3;
    config.data.most_context_views = Some(4);
    config.optimizer.ema = Some(0.998);
    config.output = OutputConfig { log_every: 50, checkpoint_every: 250, sample_every: 1000 };
    if name == "micro" {
        config.data.context_views = 2;
        config.data.most_context_views = Some(3);
        config.data.pool = 4;
        config.output = OutputConfig { log_every: 5, checkpoint_every: 20, sample_every: 20 };
    }
    Some(config)
}

/// Drawn scenes, cells at random budgets.
fn drawn(steps: usize, rate: f64) -> StageConfig<PhotoRecipe> {
    StageConfig {
        name: "drawn".into(),
        steps,
        tuples: 1,
        rate,
        warmup: 200.min(steps / 10),
        floor: 0.05,
        frozen: Vec::new(),
        recompute: false,
        model: PhotoStage { allocation: StageAllocation::QuadtreeMix, dense: 1.0 / 16.0, budget: 0.5 },
        losses: PhotoLosses {
            // The weights of a fit: 0.8 L1 and 0.2 (1 - SSIM).
            image: ImageLosses { ssim: 0.4, ..ImageLosses::default() },
            l1: 0.8,
            depth: 0.05,
            router: RouterLosses { error_regression: 0.02, ..RouterLosses::default() },
        },
    }
}
