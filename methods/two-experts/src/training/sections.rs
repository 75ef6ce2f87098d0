//! 2Xplat's sections of a configuration.

use super::TwoExpertsRecipe;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use weaver_trainer::losses::{ImageLosses, PoseLosses};
use weaver_trainer::{CameraMode, LossSection, StageConfig};

/// Settings of a stage of 2Xplat.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct TwoExpertsStage {
    /// Further tuples per step that only train the geometry expert.
    #[schemars(range(max = 10_000))]
    pub pose_tuples: usize,
    /// The learning rate of the geometry expert, as a fraction of the stage's rate.
    #[schemars(range(min = 0.0))]
    pub geometry_rate: f64,
    /// Source of the cameras that the appearance expert is told, and pictures are drawn from: given, or predicted by
    /// the geometry expert, which then sees the target photos as well.
    pub cameras: CameraMode,
}

/// Evaluation of 2Xplat, and its use unless a call says otherwise.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct TwoExpertsEvaluation {
    /// Source of the cameras.
    pub cameras: CameraMode,
}

/// Weights of 2Xplat's losses; 0 leaves a loss out.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct TwoExpertsLosses {
    /// Losses on rendered images against photos.
    pub image: ImageLosses,
    /// Losses on predicted cameras against those of the data.
    pub pose: PoseLosses,
    /// Weight of the mean opacity.
    #[schemars(range(min = 0.0))]
    pub opacity: f64,
}

impl LossSection for TwoExpertsLosses {
    fn image(&self) -> Option<(&'static str, &ImageLosses)> {
        Some(("image", &self.image))
    }
}

/// Facts that follow from a stage's settings.
pub(super) trait Runs {
    /// True if the geometry expert runs in the stage.
    fn runs_geometry(&self) -> bool;
}

impl Runs for StageConfig<TwoExpertsRecipe> {
    fn runs_geometry(&self) -> bool {
        self.losses.pose.sum() > 0.0 || self.tuples > 0 && self.model.cameras == CameraMode::Predicted
    }
}
