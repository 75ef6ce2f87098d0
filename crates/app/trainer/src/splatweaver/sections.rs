//! SplatWeaver's sections of a stage's configuration.

use crate::losses::{DepthLosses, ImageLosses, PoseLosses};
use crate::{CameraMode, Error, LossSection};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::fmt;
use std::ops::RangeInclusive;
use std::str::FromStr;
use weaver_router::{Allocation, AllocationKind, QuadtreeMix, TrainingMix};

/// Settings of a stage of SplatWeaver.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct StageSettings {
    /// Further tuples per step that only train the poses.
    #[schemars(range(max = 10_000))]
    pub pose_tuples: usize,
    /// The learning rate of the backbone and the camera head, as a fraction of the stage's rate.
    #[schemars(range(min = 0.0))]
    pub backbone_rate: f64,
    /// Which pixels get Gaussians: mix (random budgets, densities and thresholds, so that the budget can be chosen at
    /// test time), quadtree-mix, quadtree-grid-mix (cells at random budgets), or an allocation of evaluation: sampled,
    /// argmax, dithered, quadtree, quadtree-grid, grid, random or fixed:K.
    #[schemars(with = "String")]
    pub allocation: StageAllocation,
    /// Share of a mix's steps in which every pixel has the same number of Gaussians, drawn from 1 to the most that it
    /// can have, so that all experts learn.
    #[serde(default)]
    #[schemars(range(min = 0.0, max = 1.0))]
    pub dense: f64,
    /// Gaussians per context pixel, for allocations that have a budget.
    #[schemars(range(min = 0.0, max = 1.0))]
    pub budget: f64,
    /// Gaussians per context pixel, one of which `mix` draws each step; as often as they stand here.
    #[serde(default = "budgets")]
    #[schemars(inner(range(min = 0.0, max = 1.0)))]
    pub budgets: Vec<f64>,
    /// Cameras of the context views, for unprojection and rendering.
    pub cameras: CameraMode,
    /// True if held-out target views are rendered too, with the data's cameras.
    pub render_targets: bool,
}

/// Budgets that runs drew from before they were a setting.
fn budgets() -> Vec<f64> {
    TrainingMix::default().budgets
}

impl StageSettings {
    /// The experts that pixels may get, of a model whose largest is `most`; expert 0 aside.
    pub fn experts(&self, most: u8) -> RangeInclusive<u8> {
        match self.allocation {
            StageAllocation::Mix | StageAllocation::QuadtreeGridMix => 1..=if self.dense > 0.0 { most } else { 1 },
            StageAllocation::QuadtreeMix => 1..=most,
            StageAllocation::Kind(kind) => kind.experts(most),
        }
    }
}

/// Which pixels get Gaussians in training.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(try_from = "String", into = "String")]
pub enum StageAllocation {
    /// Random budgets, densities and thresholds, so that the budget can be chosen at test time.
    Mix,
    /// Cells of quadtrees at random budgets.
    QuadtreeMix,
    /// Even cells at random budgets.
    QuadtreeGridMix,
    /// An allocation of evaluation.
    Kind(AllocationKind),
}

impl StageAllocation {
    /// True if the router itself chooses each pixel's expert, so that losses on its choice reach it.
    pub fn is_routed(self) -> bool {
        matches!(self, Self::Kind(AllocationKind::Sampled | AllocationKind::Argmax))
    }

    /// The allocation of a step: a mix draws `dense` steps with equal counts and, but for cells, from these `budgets`;
    /// an allocation of evaluation has this `budget`. For a model of so many experts, the one that makes nothing
    /// included.
    pub(crate) fn allocation(
        self,
        dense: f64,
        budget: f64,
        budgets: &[f64],
        experts: usize,
    ) -> Result<Box<dyn Allocation<f32>>, Error> {
        Ok(match self {
            Self::Mix => Box::new(TrainingMix { dense, budgets: budgets.to_vec(), ..TrainingMix::default() }),
            Self::QuadtreeMix => Box::new(QuadtreeMix { dense, ..QuadtreeMix::default() }),
            Self::QuadtreeGridMix => Box::new(QuadtreeMix { grid: true, dense, ..QuadtreeMix::default() }),
            Self::Kind(kind) => kind.allocation(budget, experts).map_err(|e| Error::Input(e.to_string()))?,
        })
    }
}

impl FromStr for StageAllocation {
    type Err = String;

    fn from_str(name: &str) -> Result<Self, String> {
        match name {
            "mix" => Ok(Self::Mix),
            "quadtree-mix" => Ok(Self::QuadtreeMix),
            "quadtree-grid-mix" => Ok(Self::QuadtreeGridMix),
            _ => name.parse().map(Self::Kind).map_err(|e| format!("{e}, or mix, quadtree-mix, quadtree-grid-mix")),
        }
    }
}

impl TryFrom<String> for StageAllocation {
    type Error = String;

    fn try_from(name: String) -> Result<Self, String> {
        name.parse()
    }
}

impl From<StageAllocation> for String {
    fn from(allocation: StageAllocation) -> Self {
        allocation.to_string()
    }
}

impl fmt::Display for StageAllocation {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Mix => f.write_str("mix"),
            Self::QuadtreeMix => f.write_str("quadtree-mix"),
            Self::QuadtreeGridMix => f.write_str("quadtree-grid-mix"),
            Self::Kind(kind) => kind.fmt(f),
        }
    }
}

/// Evaluation of SplatWeaver, and its use unless a call says otherwise.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct EvaluationSettings {
    /// Source of the cameras.
    pub cameras: CameraMode,
    /// Which pixels get Gaussians: sampled, argmax, dithered, quadtree, quadtree-grid, grid, random or fixed:K. Without
    /// it dithered.
    #[serde(default, skip_serializing_if = "Option::is_none", with = "allocation_name")]
    #[schemars(with = "Option<String>")]
    pub allocation: Option<AllocationKind>,
    /// Gaussians per context pixel, for allocations that have a budget.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schemars(range(min = 0.0, max = 1.0))]
    pub budget: Option<f64>,
}

/// Allocations by their names.
mod allocation_name {
    use serde::{Deserialize, Deserializer, Serializer};
    use weaver_router::AllocationKind;

    pub fn serialize<S: Serializer>(kind: &Option<AllocationKind>, serializer: S) -> Result<S::Ok, S::Error> {
        match kind {
            Some(kind) => serializer.collect_str(kind),
            None => serializer.serialize_none(),
        }
    }

    pub fn deserialize<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Option<AllocationKind>, D::Error> {
        let name = Option::<String>::deserialize(deserializer)?;
        name.map(|name| name.parse().map_err(serde::de::Error::custom)).transpose()
    }
}

/// Weights of SplatWeaver's losses; 0 leaves a loss out.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Losses {
    /// Losses on rendered images against photos.
    pub image: ImageLosses,
    /// Losses on predicted cameras against those of the data.
    pub pose: PoseLosses,
    /// Losses on depth where the data knows it.
    pub depth: DepthLosses,
    /// Losses on the router.
    pub router: RouterLosses,
}

impl LossSection for Losses {
    fn image(&self) -> Option<(&'static str, &ImageLosses)> {
        Some(("image", &self.image))
    }
}

/// Target of the budget loss.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum BudgetForm {
    /// Every expert its share of the pixels, as the published code does.
    Shares,
    /// At most so many Gaussians per pixel in all, as the paper reads.
    Limit,
    /// Shares while the ranking loss is on, the limit afterward. With nothing else to hold the count up, it may fall to
    /// none at all.
    SharesThenLimit,
}

/// Losses on the router.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct RouterLosses {
    /// Weight of the cross entropy of the router against the frequency ranking.
    #[schemars(range(min = 0.0))]
    pub rank: f64,
    /// Ranking classes: quantiles of wavelet energy at which E_1, E_2, ... E_M begin.
    #[schemars(inner(range(min = 0.0, max = 1.0)))]
    pub rank_quantiles: Vec<f64>,
    /// Label smoothing of the ranking.
    #[schemars(range(min = 0.0, max = 1.0))]
    pub label_smoothing: f64,
    /// Fraction of the stage after which the ranking loss is off.
    #[schemars(range(min = 0.0, max = 1.0))]
    pub rank_until: f64,
    /// Weight of the budget of the router's own allocations, sampled and argmax, in the form of `budget_form`.
    #[schemars(range(min = 0.0))]
    pub budget: f64,
    /// Target of the budget.
    pub budget_form: BudgetForm,
    /// Shares of pixels of E_1, E_2, ... E_M.
    #[schemars(inner(range(min = 0.0, max = 1.0)))]
    pub budget_shares: Vec<f64>,
    /// Gaussians per pixel above which the budget's limit acts.
    #[schemars(range(min = 0.0))]
    pub budget_limit: f64,
    /// Weight of the regression of the router onto the log error of the context renders.
    #[schemars(range(min = 0.0))]
    pub error_regression: f64,
}

impl Default for RouterLosses {
    fn default() -> Self {
        Self {
            rank: 0.0,
            rank_quantiles: vec![0.76, 0.96, 0.98],
            label_smoothing: 0.1,
            rank_until: 0.5,
            budget: 0.0,
            budget_form: BudgetForm::Shares,
            budget_shares: vec![0.2, 0.02, 0.02],
            budget_limit: 0.3,
            error_regression: 0.0,
        }
    }
}
