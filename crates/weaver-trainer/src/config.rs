//! The configuration of a run: defaults < preset < file < flags, with unknown keys refused.

mod overlay;
mod presets;

use crate::Error;
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};
use weaver_model::ModelConfig;

/// Everything that determines a run, beside the code. Saved in the run folder as `config.toml`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Config {
    /// The preset that the other values started from.
    pub preset: String,
    /// Seed of initial weights, of the order of the data and of the noise.
    pub seed: u64,
    /// Threads; 0 takes one per core. Does not change the result.
    pub threads: usize,
    /// The network.
    pub model: ModelConfig,
    /// Where scenes come from.
    pub data: DataConfig,
    /// AdamW and weight averaging.
    pub optimizer: OptimizerConfig,
    /// The stages of training, one after the other.
    pub stages: Vec<StageConfig>,
    /// What is written while training.
    pub output: OutputConfig,
    /// How the model is evaluated.
    pub evaluation: EvaluationConfig,
}

/// Where scenes come from, and which views make a tuple.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct DataConfig {
    /// Folders of captures; empty trains on the built-in procedural scenes.
    pub folders: Vec<PathBuf>,
    /// Procedural scenes only: draw a fresh scene every so many steps in place of the default set; 0 keeps the set.
    pub endless: usize,
    /// Captures without points: the mean distance from camera 0 to what the cameras see, in the capture's units; 0 says
    /// that it is not known, which is an error where it is needed.
    pub scene_scale: f64,
    /// Context views of a tuple.
    pub context_views: usize,
    /// Target views of a tuple.
    pub target_views: usize,
    /// A training view's context comes from this many nearest other training views.
    pub pool: usize,
}

/// AdamW and weight averaging.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct OptimizerConfig {
    /// Decay of the first moment.
    pub beta1: f64,
    /// Decay of the second moment.
    pub beta2: f64,
    /// Added to the root of the second moment.
    pub epsilon: f64,
    /// Decoupled weight decay, on all parameters.
    pub weight_decay: f64,
    /// Largest global norm of the gradient.
    pub clip: f64,
    /// Decay of the weights' exponential moving average; 0 evaluates the weights themselves.
    pub ema: f64,
}

/// Whose cameras a pass uses.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Cameras {
    /// The network's own.
    Predicted,
    /// The data's.
    Given,
}

impl std::fmt::Display for Cameras {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            Self::Predicted => "predicted",
            Self::Given => "given",
        })
    }
}

impl std::str::FromStr for Cameras {
    type Err = String;
    fn from_str(s: &str) -> Result<Self, String> {
        match s {
            "predicted" => Ok(Self::Predicted),
            "given" => Ok(Self::Given),
            _ => Err(format!("expected `predicted` or `given`, found `{s}`")),
        }
    }
}

/// One stage of training.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct StageConfig {
    /// Its name in logs.
    pub name: String,
    /// Optimizer steps.
    pub steps: usize,
    /// Tuples per step that are rendered. 0 trains the backbone and the camera head alone.
    pub tuples: usize,
    /// Further tuples per step that only train the poses.
    pub pose_tuples: usize,
    /// Peak learning rate of the dense heads and everything after them.
    pub rate: f64,
    /// The backbone's and the camera head's rate over `rate`.
    pub backbone_rate: f64,
    /// Steps of linear warm-up.
    pub warmup: usize,
    /// Where the cosine ends, over the peak.
    pub floor: f64,
    /// Which pixels get Gaussians: `mix` (random budgets, densities and thresholds, so that the budget is a dial at test
    /// time), or any allocation of evaluation.
    pub allocation: String,
    /// Gaussians per context pixel, for allocations that have a budget.
    pub budget: f64,
    /// Cameras of the context views, for unprojection and rendering.
    pub cameras: Cameras,
    /// Whether held-out target views are rendered too, with the data's cameras.
    pub render_targets: bool,
    /// Weights of the losses.
    pub losses: LossWeights,
}

/// What the budget loss asks for.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
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

/// Weights of the losses; 0 leaves a loss out, and so does a run of before it existed.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct LossWeights {
    /// Mean squared error of the renders.
    pub mse: f64,
    /// (1 - SSIM) / 2 of the renders.
    pub ssim: f64,
    /// LPIPS of the renders; needs `lpips_weights`.
    pub lpips: f64,
    /// File with the VGG or AlexNet weights of LPIPS.
    pub lpips_weights: PathBuf,
    /// Huber loss on the pose codes over all iterations, as published.
    pub pose_huber: f64,
    /// L1 on translation, quaternion and field of view of the emitted cameras.
    pub pose: f64,
    /// L1 on the codes before the gauge against the scene's own frame; off with endless scenes, which do not come back.
    pub pose_absolute: f64,
    /// L1 of log depth where the data knows it.
    pub depth: f64,
    /// Squared error of the rendered depth where the data knows it, as published.
    pub rendered_depth: f64,
    /// Cross entropy of the router against the frequency ranking.
    pub rank: f64,
    /// Ranking classes: quantiles of wavelet energy at which E_1, E_2, ... E_M begin.
    pub rank_quantiles: Vec<f64>,
    /// Label smoothing of the ranking.
    pub label_smoothing: f64,
    /// Budget of the router's own allocations, in the form of `budget_form`.
    pub budget: f64,
    /// What the budget asks for.
    pub budget_form: BudgetForm,
    /// Shares of pixels of E_1, E_2, ... E_M.
    pub budget_shares: Vec<f64>,
    /// Gaussians per pixel above which the budget's limit acts.
    pub budget_limit: f64,
    /// Fraction of the stage after which the ranking loss is off.
    pub rank_until: f64,
    /// Regression of the router onto the log error of the context renders.
    pub error_regression: f64,
}

impl Default for LossWeights {
    fn default() -> Self {
        Self {
            mse: 0.0,
            ssim: 0.0,
            lpips: 0.0,
            lpips_weights: PathBuf::new(),
            pose_huber: 0.0,
            pose: 0.0,
            pose_absolute: 0.0,
            depth: 0.0,
            rendered_depth: 0.0,
            rank: 0.0,
            rank_quantiles: vec![0.76, 0.96, 0.98],
            label_smoothing: 0.1,
            budget: 0.0,
            budget_form: BudgetForm::Shares,
            budget_shares: vec![0.2, 0.02, 0.02],
            budget_limit: 0.3,
            rank_until: 0.5,
            error_regression: 0.0,
        }
    }
}

/// What is written while training. None of it changes the result.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct OutputConfig {
    /// Steps between lines of metrics.jsonl.
    pub log_every: usize,
    /// Steps between checkpoints.
    pub checkpoint_every: usize,
    /// Steps between sample pictures.
    pub sample_every: usize,
}

/// How the model is evaluated.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct EvaluationConfig {
    /// Whose cameras.
    pub cameras: Cameras,
    /// Which pixels get Gaussians: sampled, argmax, dithered, grid, random or fixed:K.
    pub allocation: String,
    /// Gaussians per context pixel, for allocations that have a budget.
    pub budget: f64,
}

impl Config {
    /// The configuration of a preset.
    pub fn preset(name: &str) -> Result<Self, Error> {
        presets::preset(name).ok_or_else(|| {
            let hint = overlay::nearest(name, weaver_model::PRESETS)
                .map_or(String::new(), |n| format!("; did you mean `{n}`?"));
            let known = weaver_model::PRESETS.join(", ");
            Error::Config { place: "preset".into(), message: format!("expected one of {known}, found `{name}`{hint}") }
        })
    }

    /// Resolves defaults < preset < file < settings (`key=value`, as in `--set`).
    ///
    /// The file may name the preset; a preset given here wins.
    pub fn resolve(preset: Option<&str>, file: Option<&Path>, settings: &[String]) -> Result<Self, Error> {
        let table = file.map(overlay::read_file).transpose()?.unwrap_or_default();
        let named = table.get("preset").and_then(toml::Value::as_str);
        let base = Self::preset(preset.or(named).unwrap_or("tiny"))?;
        let mut tree = base.tree();
        if let Some(path) = file {
            let source = path.display().to_string();
            let mut table = table.clone();
            table.remove("preset");
            overlay::merge(&mut tree, toml::Value::Table(table), &source)?;
        }
        for setting in settings {
            overlay::set(&mut tree, setting)?;
        }
        let source = file.map_or("--set".into(), |f| f.display().to_string());
        Self::from_tree(tree, &source)
    }

    /// Reads the resolved configuration of a run.
    pub fn read(path: &Path) -> Result<Self, Error> {
        Self::from_toml(&weaver_io::read_text(path)?, &path.display().to_string())
    }

    /// Parses a resolved configuration; `source` names it in errors.
    pub fn from_toml(text: &str, source: &str) -> Result<Self, Error> {
        let table: toml::Table =
            text.parse().map_err(|e| Error::Config { place: source.into(), message: format!("{e}") })?;
        Self::from_tree(toml::Value::Table(table), source)
    }

    /// As TOML text.
    pub fn to_toml(&self) -> String {
        toml::to_string(self).expect("a configuration is plain data")
    }

    fn tree(&self) -> toml::Value {
        toml::Value::try_from(self).expect("a configuration is plain data")
    }

    fn from_tree(tree: toml::Value, source: &str) -> Result<Self, Error> {
        let mut config: Self = overlay::deserialize(tree, source)?;
        if config.data.endless > 0 {
            // A frame of its own is of no use to a scene that does not come back.
            config.stages.iter_mut().for_each(|stage| stage.losses.pose_absolute = 0.0);
        }
        config.check().map_err(|message| Error::Config { place: source.into(), message })?;
        Ok(config)
    }

    /// Steps of all stages.
    pub fn steps(&self) -> usize {
        self.stages.iter().map(|s| s.steps).sum()
    }

    /// Rescales the stages to `total` steps in proportion; warm-ups shrink along, but do not grow.
    pub fn rescale(&mut self, total: usize) {
        let before = self.steps().max(1);
        let (mut done, mut assigned) = (0, 0);
        for stage in &mut self.stages {
            done += stage.steps;
            let end = (done * total + before / 2) / before;
            let steps = end - assigned;
            stage.warmup = stage.warmup.min((stage.warmup * steps).div_ceil(stage.steps.max(1)));
            stage.steps = steps;
            assigned = end;
        }
    }

    fn check(&self) -> Result<(), String> {
        self.model.check()?;
        if self.stages.is_empty() {
            return Err("stages: expected at least one".into());
        }
        let d = &self.data;
        if d.context_views < 2 || d.target_views == 0 || d.pool < d.context_views {
            return Err(format!(
                "data: expected context_views >= 2, target_views >= 1 and pool >= context_views, found {}, {} and {}",
                d.context_views, d.target_views, d.pool
            ));
        }
        for (i, stage) in self.stages.iter().enumerate() {
            let at = |key: &str, expected: &str, found: String| {
                Err(format!("stages.{i}.{key}: expected {expected}, found {found}"))
            };
            if stage.tuples + stage.pose_tuples == 0 {
                return at("tuples", "tuples or pose_tuples above 0", "0 and 0".into());
            }
            if !(stage.rate > 0.0 && stage.rate.is_finite()) {
                return at("rate", "a positive number", stage.rate.to_string());
            }
            if !(0.0..=3.0).contains(&stage.budget) {
                return at("budget", "0 to 3 Gaussians per pixel", stage.budget.to_string());
            }
            if stage.allocation != "mix" {
                let kind = stage.allocation.parse::<weaver_router::AllocationKind>();
                kind.map_err(|e| format!("stages.{i}.allocation: {e}, or mix"))?;
            }
            let experts = self.model.gaussians.experts;
            let lists =
                [("rank_quantiles", &stage.losses.rank_quantiles), ("budget_shares", &stage.losses.budget_shares)];
            for (key, list) in lists {
                if list.len() != experts || list.iter().any(|x| !(0.0..=1.0).contains(x)) {
                    let expected = format!("{experts} numbers between 0 and 1, one for each expert from E_1 on");
                    return at(&format!("losses.{key}"), &expected, format!("{list:?}"));
                }
            }
            if stage.losses.lpips > 0.0 && stage.losses.lpips_weights.as_os_str().is_empty() {
                return at("losses.lpips_weights", "a file, since lpips is not 0", "nothing".into());
            }
        }
        Ok(())
    }
}
