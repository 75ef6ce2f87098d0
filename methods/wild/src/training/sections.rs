//! WildSplatter's sections of a configuration.

use super::WildRecipe;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use weaver_trainer::losses::{ImageLosses, PoseLosses};
use weaver_trainer::{CameraMode, LossSection, StageConfig};

/// Settings of a stage of WildSplatter.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct WildStage {
    /// Source of the cameras that Gaussians are made with: given, or predicted. Targets are drawn from given ones.
    pub cameras: CameraMode,
    /// With predicted cameras: whether Gaussians are laid over the data's points by a scale and a shift of each tuple,
    /// without gradient, before they are drawn, as published. Tuples on which that fails teach nothing by their
    /// pictures.
    #[serde(default)]
    pub aligned: bool,
    /// True if colors follow the embedding of the target's photo; `false`, with an embedding of zeros, is for
    /// ablations.
    pub embed: bool,
    /// Fraction of the targets whose photos tell their light with one half, the left or the right one: the other is
    /// filled with its mean, so that no embedding can rest on the whole picture.
    #[serde(default)]
    #[schemars(range(min = 0.0, max = 1.0))]
    pub halves: f64,
}

/// Evaluation of WildSplatter, and its use unless a call says otherwise.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct WildEvaluation {
    /// Source of the cameras.
    pub cameras: CameraMode,
}

/// Weights of WildSplatter's losses; 0 leaves a loss out.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct WildLosses {
    /// Losses on rendered targets against photos, where these show what a context photo shows: the mean squared error
    /// over all pixels, as published, SSIM over whole windows.
    pub image: ImageLosses,
    /// Losses on predicted cameras against those of the data.
    pub pose: PoseLosses,
    /// Weight of the difference of log depth, where depth is known.
    #[schemars(range(min = 0.0))]
    pub depth: f64,
}

impl LossSection for WildLosses {
    fn image(&self) -> Option<(&'static str, &ImageLosses)> {
        Some(("image", &self.image))
    }
}

/// Facts that follow from a stage's settings.
pub(super) trait Runs {
    /// True if the stage draws pictures.
    fn renders(&self) -> bool;
}

impl Runs for StageConfig<WildRecipe> {
    fn renders(&self) -> bool {
        self.losses.image.weights().iter().any(|(_, weight)| *weight > 0.0)
    }
}
