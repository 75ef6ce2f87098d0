//! The recipe of a model: its part of training.

use crate::losses::{ImageLosses, ImageNetworks};
use crate::{CameraMode, Config, Error, Example, StageConfig, Terms};
use schemars::JsonSchema;
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};
use std::fmt::Debug;
use std::sync::Arc;
use weaver_autograd::{ParamId, Params, Var};
use weaver_inference::{Checkpoint, Defaults, Predictor};
use weaver_kernels::random::Stream;
use weaver_nn::Context;
use weaver_pose::CameraVars;
use weaver_splat::{GaussianVars, RasterSettings, Rasterize, WorkspacePool};

/// A section of the configuration: plain data whose fields have documentation.
pub trait Section:
    Clone + Debug + PartialEq + Serialize + DeserializeOwned + JsonSchema + Send + Sync + 'static
{
}

impl<S> Section for S where
    S: Clone + Debug + PartialEq + Serialize + DeserializeOwned + JsonSchema + Send + Sync + 'static
{
}

/// The section `stages.N.losses`: weights of the losses.
pub trait LossSection: Section {
    /// The losses on rendered images, and the key of their table in this section, empty if they are the section itself;
    /// the trainer checks them and loads the weights of LPIPS. None for a model that renders nothing.
    fn image(&self) -> Option<(&'static str, &ImageLosses)>;
}

impl LossSection for ImageLosses {
    fn image(&self) -> Option<(&'static str, &ImageLosses)> {
        Some(("", self))
    }
}

/// A section without keys, for models that leave nothing to choose there.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct NoSettings {}

impl LossSection for NoSettings {
    fn image(&self) -> Option<(&'static str, &ImageLosses)> {
        None
    }
}

/// Configuration, network, training and use of a model.
///
/// A recipe is a unit type; everything that varies is in its configuration sections. The trainer calls
/// [`Recipe::objective`] once a step, walks back from the terms' sum, and updates the parameters.
pub trait Recipe: Copy + Debug + Default + PartialEq + Send + Sync + 'static {
    /// The model's name on the command line, in configurations and in checkpoints.
    const ARCHITECTURE: &'static str;
    /// Names of the presets; the first is the default.
    const PRESETS: &'static [&'static str];
    /// The network, made of parameter ids.
    type Network: Debug + Send + Sync + 'static;
    /// The section `model`: sizes and switches of the network.
    type Model: Section;
    /// The section `stages.N.model`: the model's settings of a stage.
    type Stage: Section;
    /// The section `stages.N.losses`: weights of the losses.
    type Losses: LossSection;
    /// The section `evaluation`: how the model is evaluated, and used unless a call says otherwise.
    type Evaluation: Section;

    /// The configuration of a preset; `None` for an unknown name.
    fn preset(name: &str) -> Option<Config<Self>>;

    /// Settles settings that follow from others, after the configuration was resolved.
    fn settle(_config: &mut Config<Self>) {}

    /// Checks the model's own sections.
    ///
    /// # Errors
    /// A message that names the key, the expected value and the value found.
    fn check(_config: &Config<Self>) -> Result<(), String> {
        Ok(())
    }

    /// Height and width of the photos, pixels.
    fn image_size(model: &Self::Model) -> [usize; 2];

    /// Adds the parameters of a new network, drawn from `seed`.
    fn build(model: &Self::Model, params: &mut Params<f32>, seed: u64) -> Self::Network;

    /// Declares the same parameters without values, so that their memory can be checked before it is allocated. A model
    /// that declares none is built unchecked.
    fn declare(_model: &Self::Model, _params: &mut Params<f32>) {}

    /// Parameters that share a learning rate; all of them, unless a model says otherwise. Every trained parameter is in
    /// exactly one group.
    fn groups(params: &Params<f32>) -> Vec<Vec<ParamId>> {
        vec![params.ids().collect()]
    }

    /// The factor on the stage's rate for each group of [`Recipe::groups`].
    fn group_rates(_stage: &StageConfig<Self>) -> Vec<f64> {
        vec![1.0]
    }

    /// Leading parts of the names of parameters that a stage has no loss for; they stay as they are.
    fn untrained(_stage: &StageConfig<Self>) -> Vec<&'static str> {
        Vec::new()
    }

    /// Source of the cameras that the model is evaluated with; the data's, unless a model says otherwise.
    fn cameras(_evaluation: &Self::Evaluation) -> CameraMode {
        CameraMode::Given
    }

    /// Defaults in a checkpoint for the use of the model.
    fn defaults(config: &Config<Self>) -> Defaults {
        Defaults { seed: config.seed, ..Defaults::default() }
    }

    /// Tuples that a step of the stage needs.
    fn tuples(stage: &StageConfig<Self>) -> usize {
        stage.tuples
    }

    /// Makes the steps of a stage that draws their size as large as they get, for a dry run to measure one.
    fn enlarge(_stage: &mut StageConfig<Self>, _model: &Self::Model) {}

    /// Description of a stage's step, in a few words.
    fn describe(stage: &StageConfig<Self>) -> String {
        format!("{} tuples", Self::tuples(stage))
    }

    /// Label of a progress bar beside the step.
    fn label(report: &crate::StepReport) -> String {
        format!("{}, loss {:.4}", report.stage, report.loss)
    }

    /// Runs the network on a step's examples and collects the loss.
    ///
    /// # Errors
    /// When the stage's settings do not suit the network.
    fn objective<'t>(
        cx: Context<'t, '_, f32>,
        network: &Self::Network,
        step: &Step<'_, Self>,
        examples: &[Example],
    ) -> Result<Terms<'t>, Error>;

    /// The network as a predictor, with the settings of `config.evaluation`.
    ///
    /// # Errors
    /// When the settings do not suit the network.
    fn predictor(
        network: Arc<Self::Network>,
        params: Params<f32>,
        config: &Config<Self>,
    ) -> Result<Box<dyn Predictor>, Error>;

    /// The predictor that a checkpoint describes by itself, without the configuration of its run.
    ///
    /// # Errors
    /// When the checkpoint is of another model, or its tensors do not fit.
    fn from_checkpoint(checkpoint: &Checkpoint) -> Result<Box<dyn Predictor>, Error>;
}

/// Inputs of a step's objective beside the network and the examples.
#[derive(Debug)]
pub struct Step<'a, R: Recipe> {
    /// The whole configuration.
    pub config: &'a Config<R>,
    /// The stage.
    pub stage: &'a StageConfig<R>,
    /// Steps of this stage that were done before.
    pub local: usize,
    /// Networks that compare images, where a stage needs them.
    pub networks: &'a ImageNetworks,
    /// Memory of the rasterizer, kept from step to step.
    pub workspaces: &'a WorkspacePool<f32>,
    /// Random numbers of this step.
    pub stream: Stream,
}

impl<R: Recipe> Step<'_, R> {
    /// Draws Gaussians for V cameras on white: images `[V, 3, H, W]` of the configured size, clamped to [0, 1].
    pub fn render<'t>(&self, gaussians: &GaussianVars<'t, f32>, cameras: &CameraVars<'t>) -> Var<'t, f32> {
        let [height, width] = R::image_size(&self.config.model);
        let background = gaussians.means.tape().constant(&[1.0; 3], [3]);
        let op = Rasterize::new(width, height, RasterSettings::default(), self.workspaces).without_depth();
        op.apply(gaussians, cameras, background).image.permute(&[0, 3, 1, 2]).clamp(0.0, 1.0)
    }
}
