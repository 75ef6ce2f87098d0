//! 2Xplat's training: its recipe for the trainer.

mod objective;
mod presets;
mod sections;

pub use sections::{TwoExpertsEvaluation, TwoExpertsLosses, TwoExpertsStage};

use crate::{TwoExperts, TwoExpertsConfig, TwoExpertsPredictor};
use sections::Runs;
use std::sync::Arc;
use weaver_autograd::{ParamId, Params};
use weaver_inference::{Checkpoint, Network, Predictor};
use weaver_nn::Context;
use weaver_trainer::{CameraMode, Config, Error, Example, Recipe, StageConfig, Step, Terms};

/// Trains 2Xplat: its geometry expert, its appearance expert with given cameras, then both through each other.
///
/// The optimizer has two groups of parameters, one for each expert.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct TwoExpertsRecipe;

/// Leading parts of the names of the geometry expert's parameters.
const GEOMETRY: [&str; 2] = ["aggregator.", "camera_head."];
/// Leading part of the names of the appearance expert's parameters.
const APPEARANCE: &str = "appearance.";

impl Recipe for TwoExpertsRecipe {
    const ARCHITECTURE: &'static str = TwoExperts::NAME;
    const PRESETS: &'static [&'static str] = &TwoExpertsConfig::PRESETS;
    type Network = TwoExperts;
    type Model = TwoExpertsConfig;
    type Stage = TwoExpertsStage;
    type Losses = TwoExpertsLosses;
    type Evaluation = TwoExpertsEvaluation;

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
        let (views, group) = (config.data.most_context(), config.model.appearance.group);
        if views > 1 && !views.is_multiple_of(group) {
            return Err(format!(
                "data.context_views: expected a multiple of model.appearance.group, {group}, found {views}"
            ));
        }
        config.stages.iter().enumerate().try_for_each(|(i, stage)| objective::check(stage, &format!("stages.{i}")))
    }

    fn image_size(model: &TwoExpertsConfig) -> [usize; 2] {
        [model.height, model.width]
    }

    fn build(model: &TwoExpertsConfig, params: &mut Params<f32>, seed: u64) -> TwoExperts {
        TwoExperts::new(model.clone(), params, seed)
    }

    fn declare(model: &TwoExpertsConfig, params: &mut Params<f32>) {
        TwoExperts::declare(model.clone(), params);
    }

    fn groups(params: &Params<f32>) -> Vec<Vec<ParamId>> {
        let group = |appearance: bool| {
            params.iter().filter(|(_, p)| p.name().starts_with(APPEARANCE) == appearance).map(|(id, _)| id).collect()
        };
        vec![group(false), group(true)]
    }

    fn group_rates(stage: &StageConfig<Self>) -> Vec<f64> {
        vec![stage.model.geometry_rate, 1.0]
    }

    fn untrained(stage: &StageConfig<Self>) -> Vec<&'static str> {
        let mut untrained = Vec::new();
        let pose = &stage.losses.pose;
        if !stage.runs_geometry() {
            untrained.extend(GEOMETRY);
        } else if pose.l1 + pose.huber + pose.absolute == 0.0 {
            // These tokens enter the first refinement only, and the losses at hand see the output of the last one.
            untrained.push("camera_head.empty_pose_tokens");
        }
        if stage.tuples == 0 {
            untrained.push(APPEARANCE);
        }
        untrained
    }

    fn cameras(evaluation: &TwoExpertsEvaluation) -> CameraMode {
        evaluation.cameras
    }

    fn tuples(stage: &StageConfig<Self>) -> usize {
        stage.tuples + stage.model.pose_tuples
    }

    fn describe(stage: &StageConfig<Self>) -> String {
        format!("{} rendered and {} posed tuples", stage.tuples, stage.model.pose_tuples)
    }

    fn objective<'t>(
        cx: Context<'t, '_, f32>,
        network: &TwoExperts,
        step: &Step<'_, Self>,
        examples: &[Example],
    ) -> Result<Terms<'t>, Error> {
        Ok(objective::terms(cx, network, step, examples))
    }

    fn predictor(
        network: Arc<TwoExperts>,
        params: Params<f32>,
        _config: &Config<Self>,
    ) -> Result<Box<dyn Predictor>, Error> {
        Ok(Box::new(TwoExpertsPredictor::new(network, params)))
    }
    fn from_checkpoint(checkpoint: &Checkpoint) -> Result<Box<dyn Predictor>, Error> {
        Ok(Box::new(TwoExpertsPredictor::from_checkpoint(checkpoint)?))
    }
}
