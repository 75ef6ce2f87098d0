//! The sections of a configuration that are the photo network's own.

use crate::LossSection;
use crate::losses::ImageLosses;
use crate::splatweaver::{RouterLosses, StageAllocation};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use weaver_router::AllocationKind;

/// Settings of a stage of the photo network.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct PhotoStage {
    /// Which pixels get Gaussians: quadtree-mix or quadtree-grid-mix (cells at random budgets), mix (pixels at random
    /// budgets), or an allocation of evaluation: sampled, argmax, dithered, quadtree, quadtree-grid, grid, random or
    /// fixed:K.
    #[schemars(with = "String")]
    pub allocation: StageAllocation,
    /// Share of a mix's steps in which every pixel has the same number of Gaussians, drawn from 1 to the most that it
    /// can have, so that all experts learn.
    #[schemars(range(min = 0.0, max = 1.0))]
    pub dense: f64,
    /// Gaussians per pixel that is kept, for allocations that have a budget.
    #[schemars(range(min = 0.0, max = 1.0))]
    pub budget: f64,
}

/// Weights of the photo network's losses; 0 leaves a loss out.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct PhotoLosses {
    /// Losses on rendered images against photos.
    pub image: ImageLosses,
    /// Weight of the mean absolute error of the renders.
    #[schemars(range(min = 0.0))]
    pub l1: f64,
    /// Weight of the negative log likelihood of true log depth under the predicted Laplacian.
    #[schemars(range(min = 0.0))]
    pub depth: f64,
    /// Losses on the router.
    pub router: RouterLosses,
}

impl LossSection for PhotoLosses {
    fn image(&self) -> Option<(&'static str, &ImageLosses)> {
        Some(("image", &self.image))
    }
}

/// Evaluation of the photo network, and its use unless a call says otherwise.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct PhotoEvaluation {
    /// Which pixels get Gaussians: quadtree, quadtree-grid, sampled, argmax, dithered, grid, random or fixed:K.
    pub allocation: String,
    /// Gaussians per pixel that is kept, for allocations that have a budget.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schemars(range(min = 0.0, max = 3.0))]
    pub budget: Option<f64>,
}

impl PhotoEvaluation {
    pub(super) fn kind(&self) -> Result<AllocationKind, String> {
        self.allocation.parse().map_err(|e| format!("evaluation.allocation: {e}"))
    }

    /// Checks the allocation for a model of so many experts.
    pub(super) fn check(&self, experts: usize) -> Result<(), String> {
        let allocation = self.kind()?.allocation::<f32>(self.budget.unwrap_or(1.0), experts);
        allocation.map(|_| ()).map_err(|e| format!("evaluation.allocation: {e}"))
    }
}
