//! SplatWeaver's recipe.

mod check;
mod objective;
mod presets;
pub(crate) mod routing;
mod sections;

pub use objective::Objective;
pub use sections::{BudgetForm, EvaluationSettings, Losses, RouterLosses, StageAllocation, StageSettings};

use crate::{CameraMode, Config, Error, Example, Recipe, StageConfig, Step, Terms};
use std::collections::BTreeSet;
use std::sync::Arc;
use weaver_autograd::{ParamId, Params};
use weaver_inference::{Checkpoint, Defaults, Predictor, SplatWeaverPredictor};
use weaver_model::{ModelConfig, SplatWeaver};
use weaver_nn::Context;
use weaver_router::AllocationKind;

/// Trains SplatWeaver, from photos with or without their cameras.
///
/// The optimizer has two groups of parameters: the backbone with the camera head, and the dense heads with everything
/// after them.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct SplatWeaverRecipe;

/// Leading parts of the names of the parameters that learn at the full rate: the dense heads and everything after them.
const DENSE: [&str; 2] = ["depth_head.", "gaussian_param_head."];

impl SplatWeaverRecipe {
    /// The experts that training with this configuration gives pixels to.
    pub fn trained_experts(config: &Config<Self>) -> Vec<u8> {
        let most = u8::try_from(config.model.gaussians.max_per_pixel).unwrap_or(u8::MAX);
        let rendered = config.stages.iter().filter(|stage| stage.tuples > 0 && stage.steps > 0);
        let used = rendered.flat_map(|stage| stage.model.experts(most));
        used.collect::<BTreeSet<u8>>().into_iter().collect()
    }
}

impl Recipe for SplatWeaverRecipe {
    const ARCHITECTURE: &'static str = SplatWeaverPredictor::ARCHITECTURE;
    const PRESETS: &'static [&'static str] =
        &["tiny", "micro", "tiny-endless", "tiny-published", "tiny-dagger", "generalist", "small", "medium"];
    type Network = SplatWeaver;
    type Model = ModelConfig;
    type Stage = StageSettings;
    type Losses = Losses;
    type Evaluation = EvaluationSettings;

    fn preset(name: &str) -> Option<Config<Self>> {
        presets::preset(name)
    }

    fn settle(config: &mut Config<Self>) {
        if config.data.endless.is_some() {
            // A frame of its own is of no use to a scene that does not come back.
            config.stages.iter_mut().for_each(|stage| stage.losses.pose.absolute = 0.0);
        }
    }

    fn check(config: &Config<Self>) -> Result<(), String> {
        config.model.check()?;
        check::stages(config)?;
        check::evaluation(config)
    }

    fn image_size(model: &ModelConfig) -> [usize; 2] {
        [model.height, model.width]
    }

    fn build(model: &ModelConfig, params: &mut Params<f32>, seed: u64) -> SplatWeaver {
        SplatWeaver::new(model.clone(), params, seed)
    }

    fn declare(model: &ModelConfig, params: &mut Params<f32>) {
        SplatWeaver::declare(model.clone(), params);
    }

    fn groups(params: &Params<f32>) -> Vec<Vec<ParamId>> {
        let is_dense = |name: &str| DENSE.iter().any(|module| name.starts_with(module));
        let group =
            |dense: bool| params.iter().filter(|(_, p)| is_dense(p.name()) == dense).map(|(id, _)| id).collect();
        vec![group(false), group(true)]
    }

    fn group_rates(stage: &StageConfig<Self>) -> Vec<f64> {
        vec![stage.model.backbone_rate, 1.0]
    }

    fn untrained(stage: &StageConfig<Self>) -> Vec<&'static str> {
        if stage.tuples == 0 {
            return vec!["depth_head", "gaussian_param_head", "stereo"];
        }
        let router = &stage.losses.router;
        let learned = stage.model.allocation.is_routed();
        if learned || router.rank > 0.0 || router.error_regression > 0.0 {
            Vec::new()
        } else {
            vec![
                "gaussian_param_head.gs_moe.gating",
                "gaussian_param_head.wave_merger1",
                "gaussian_param_head.wave_merger2",
            ]
        }
    }

    fn cameras(evaluation: &EvaluationSettings) -> CameraMode {
        evaluation.cameras
    }

    fn defaults(config: &Config<Self>) -> Defaults {
        let EvaluationSettings { allocation, budget, .. } = config.evaluation;
        let allocation = allocation.map(|kind| kind.to_string());
        Defaults { seed: config.seed, allocation, budget, trained_experts: Self::trained_experts(config) }
    }

    fn tuples(stage: &StageConfig<Self>) -> usize {
        stage.tuples + stage.model.pose_tuples
    }

    fn enlarge(stage: &mut StageConfig<Self>, model: &ModelConfig) {
        let settings = &mut stage.model;
        if !matches!(settings.allocation, StageAllocation::Kind(_)) {
            let most = if settings.dense > 0.0 { model.gaussians.max_per_pixel } else { 1 };
            settings.allocation = StageAllocation::Kind(AllocationKind::Fixed(most as u8));
        }
    }

    fn describe(stage: &StageConfig<Self>) -> String {
        format!("{} rendered and {} posed tuples", stage.tuples, stage.model.pose_tuples)
    }

    fn objective<'t>(
        cx: Context<'t, '_, f32>,
        network: &SplatWeaver,
        step: &Step<'_, Self>,
        examples: &[Example],
    ) -> Result<Terms<'t>, Error> {
        let stage = step.stage;
        let StageSettings { allocation, dense, budget, ref budgets, .. } = stage.model;
        let experts = network.config().gaussians.experts();
        let allocation = allocation.allocation(dense, budget, budgets, experts)?;
        let objective = Objective {
            stage,
            ranking: (step.local as f64) < stage.losses.router.rank_until * stage.steps as f64,
            allocation: &*allocation,
            networks: step.networks,
            workspaces: step.workspaces,
            stream: step.stream,
        };
        Ok(objective.terms(cx, network, examples))
    }

    fn predictor(
        network: Arc<SplatWeaver>,
        params: Params<f32>,
        config: &Config<Self>,
    ) -> Result<Box<dyn Predictor>, Error> {
        let evaluation = &config.evaluation;
        let allocation = evaluation.allocation.unwrap_or(AllocationKind::Dithered);
        let budget = evaluation.budget.unwrap_or(1.0);
        let predictor = SplatWeaverPredictor::new(network, params, allocation, budget);
        Ok(Box::new(predictor.with_trained_experts(Self::trained_experts(config))))
    }
    fn from_checkpoint(checkpoint: &Checkpoint) -> Result<Box<dyn Predictor>, Error> {
        Ok(Box::new(SplatWeaverPredictor::from_checkpoint(checkpoint)?))
    }
}
