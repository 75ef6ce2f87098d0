//! WildSplatter's training: its recipe for the trainer.

mod frame;
mod objective;
mod presets;
mod sections;

pub use sections::{WildEvaluation, WildLosses, WildStage};

use crate::{Wild, WildConfig, WildPredictor};
use sections::Runs;
use std::sync::Arc;
use weaver_autograd::Params;
use weaver_inference::{Checkpoint, Network, Predictor};
use weaver_nn::Context;
use weaver_trainer::{CameraMode, Config, Error, Example, Recipe, StageConfig, Step, Terms};

/// Trains WildSplatter: cameras and depth on photos in different light, then surfaces and looks with both frozen.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct WildRecipe;

impl Recipe for WildRecipe {
    const ARCHITECTURE: &'static str = Wild::NAME;
    const PRESETS: &'static [&'static str] = &WildConfig::PRESETS;
    type Network = Wild;
    type Model = WildConfig;
    type Stage = WildStage;
    type Losses = WildLosses;
    type Evaluation = WildEvaluation;

    fn preset(name: &str) -> Option<Config<Self>> {
        presets::preset(name)
    }

    fn settle(config: &mut Config<Self>) {
        if config.data.endless.is_some() {
            // An absolute frame is of no use to a scene that does not come back.
            config.stages.iter_mut().for_each(|stage| stage.losses.pose.absolute = 0.0);
        }
    }

    fn check(config: &Config<Self>) -> Result<(), String> {
        config.model.check()?;
        config.stages.iter().enumerate().try_for_each(|(i, stage)| objective::check(stage, &format!("stages.{i}")))
    }

    fn image_size(model: &WildConfig) -> [usize; 2] {
        [model.height, model.width]
    }

    fn build(model: &WildConfig, params: &mut Params<f32>, seed: u64) -> Wild {
        Wild::new(model.clone(), params, seed)
    }

    fn declare(model: &WildConfig, params: &mut Params<f32>) {
        Wild::declare(model.clone(), params);
    }

    fn untrained(stage: &StageConfig<Self>) -> Vec<&'static str> {
        let mut untrained = Vec::new();
        let pose = &stage.losses.pose;
        if pose.l1 + pose.huber + pose.absolute == 0.0 {
            // Without these losses, gradients reach the last refinement only, or no part of the camera head.
            untrained.push(if pose.sum() > 0.0 { "camera_head.empty_pose_tokens" } else { "camera_head." });
        }
        if stage.losses.depth == 0.0 {
            untrained.push("depth_head.");
        }
        if !stage.renders() {
            untrained.extend(["gaussian_param_head.", "looks."]);
        }
        if !stage.renders() || !stage.model.embed {
            untrained.push("appearance.");
        }
        untrained
    }

    fn cameras(evaluation: &WildEvaluation) -> CameraMode {
        evaluation.cameras
    }

    fn describe(stage: &StageConfig<Self>) -> String {
        let what = match (stage.renders(), stage.model.embed) {
            (false, _) => "",
            (true, true) => ", rendered in their targets' light",
            (true, false) => ", rendered without a light",
        };
        format!("{} tuples{what}", stage.tuples)
    }

    fn objective<'t>(
        cx: Context<'t, '_, f32>,
        network: &Wild,
        step: &Step<'_, Self>,
        examples: &[Example],
    ) -> Result<Terms<'t>, Error> {
        Ok(objective::terms(cx, network, step, examples))
    }

    fn predictor(network: Arc<Wild>, params: Params<f32>, _config: &Config<Self>) -> Result<Box<dyn Predictor>, Error> {
        Ok(Box::new(WildPredictor::new(network, params)))
    }
    fn from_checkpoint(checkpoint: &Checkpoint) -> Result<Box<dyn Predictor>, Error> {
        Ok(Box::new(WildPredictor::from_checkpoint(checkpoint)?))
    }
}
