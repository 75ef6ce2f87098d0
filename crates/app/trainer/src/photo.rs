//! The recipe of the network for photos of any size.

mod objective;
mod presets;
mod sections;

pub use sections::{PhotoEvaluation, PhotoLosses, PhotoStage};

use crate::{Config, Error, Example, Recipe, StageConfig, Step, Terms};
use std::sync::Arc;
use weaver_autograd::Params;
use weaver_inference::{Checkpoint, Defaults, Network, Predictor};
use weaver_nn::Context;
use weaver_photo::{PhotoConfig, PhotoNetwork, PhotoPredictor};

/// Trains the network for photos of any size, on drawn scenes: depth of comparison is drawn from their true depth.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct PhotoRecipe;

impl Recipe for PhotoRecipe {
    const ARCHITECTURE: &'static str = PhotoNetwork::NAME;
    const PRESETS: &'static [&'static str] = &PhotoConfig::PRESETS;
    type Network = PhotoNetwork;
    type Model = PhotoConfig;
    type Stage = PhotoStage;
    type Losses = PhotoLosses;
    type Evaluation = PhotoEvaluation;

    fn preset(name: &str) -> Option<Config<Self>> {
        presets::preset(name)
    }

    fn check(config: &Config<Self>) -> Result<(), String> {
        config.model.check()?;
        if let Some(folder) = config.data.folders.first() {
            let expected = "expected none, as true depth is known of drawn scenes alone";
            return Err(format!("data.folders: {expected}, found {}", folder.display()));
        }
        config.stages.iter().enumerate().try_for_each(|(i, stage)| {
            objective::check(stage, config.model.gaussians.experts(), &format!("stages.{i}"))
        })?;
        config.evaluation.check(config.model.gaussians.experts())
    }

    fn image_size(model: &PhotoConfig) -> [usize; 2] {
        [model.height, model.width]
    }

    fn build(model: &PhotoConfig, params: &mut Params<f32>, seed: u64) -> PhotoNetwork {
        PhotoNetwork::new(model.clone(), params, seed)
    }

    fn declare(model: &PhotoConfig, params: &mut Params<f32>) {
        PhotoNetwork::declare(model.clone(), params);
    }

    fn untrained(stage: &StageConfig<Self>) -> Vec<&'static str> {
        let router = &stage.losses.router;
        if stage.model.allocation.is_routed() || router.rank > 0.0 || router.error_regression > 0.0 {
            return Vec::new();
        }
        vec!["gaussians.gating", "guidance"]
    }

    fn defaults(config: &Config<Self>) -> Defaults {
        let PhotoEvaluation { allocation, budget } = &config.evaluation;
        Defaults { seed: config.seed, allocation: Some(allocation.clone()), budget: *budget, ..Defaults::default() }
    }

    fn objective<'t>(
        cx: Context<'t, '_, f32>,
        network: &PhotoNetwork,
        step: &Step<'_, Self>,
        examples: &[Example],
    ) -> Result<Terms<'t>, Error> {
        objective::terms(cx, network, step, examples)
    }

    fn predictor(
        network: Arc<PhotoNetwork>,
        params: Params<f32>,
        config: &Config<Self>,
    ) -> Result<Box<dyn Predictor>, Error> {
        let allocation = config.evaluation.kind().map_err(Error::Input)?;
        let budget = config.evaluation.budget.unwrap_or(1.0);
        Ok(Box::new(PhotoPredictor::new(network, params, allocation, budget)))
    }

    fn from_checkpoint(checkpoint: &Checkpoint) -> Result<Box<dyn Predictor>, Error> {
        Ok(Box::new(PhotoPredictor::from_checkpoint(checkpoint)?))
    }
}
