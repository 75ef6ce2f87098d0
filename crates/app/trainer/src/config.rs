//! The configuration of a run: defaults < preset < file < settings, with unknown keys refused.

mod check;
mod data;
mod difference;

use crate::{Error, Recipe};
pub use data::{DataConfig, SamplerKind};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};
use weaver_run::settings::{Error as Wrong, Layers, Value};

/// Upper limit on steps and counts of steps, far beyond any run; sums and products below it do not overflow.
const MOST: u64 = 1_000_000_000;
/// The most views or tuples of one step.
const MOST_VIEWS: u64 = 10_000;

/// Everything that determines a run, beside the code. Saved in the run folder as `config.toml`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, bound = "")]
#[schemars(bound = "")]
pub struct Config<R: Recipe> {
    /// The model that is trained, by name.
    pub architecture: String,
    /// The preset that the other values started from.
    pub preset: String,
    /// Seed of initial weights, of the order of the data and of the noise.
    pub seed: u64,
    /// Threads; none takes one per core. The result does not depend on it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schemars(range(min = 1, max = 1024))]
    pub threads: Option<usize>,
    /// Checkpoint of a run that training starts from, a published checkpoint, or `built-in` for the weights that come
    /// with the program, in place of random weights: of what both networks have in equal sizes, the averaged weights
    /// are taken.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub init: Option<PathBuf>,
    /// The network.
    pub model: R::Model,
    /// Where scenes come from, and which views make a tuple.
    pub data: DataConfig,
    /// AdamW and weight averaging.
    pub optimizer: OptimizerConfig,
    /// The stages of training, one after the other.
    pub stages: Vec<StageConfig<R>>,
    /// Output while training.
    pub output: OutputConfig,
    /// Evaluation of the model, and its use unless a call says otherwise.
    pub evaluation: R::Evaluation,
}

/// AdamW and weight averaging.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct OptimizerConfig {
    /// Decay of the first moment.
    #[schemars(range(min = 0.0), extend("exclusiveMaximum" = 1))]
    pub beta1: f64,
    /// Decay of the second moment.
    #[schemars(range(min = 0.0), extend("exclusiveMaximum" = 1))]
    pub beta2: f64,
    /// Added to the root of the second moment.
    #[schemars(extend("exclusiveMinimum" = 0))]
    pub epsilon: f64,
    /// Decoupled weight decay, on all parameters.
    #[schemars(range(min = 0.0, max = 1.0))]
    pub weight_decay: f64,
    /// Largest global norm of the gradient; larger gradients are scaled down to it. A huge one clips nothing.
    #[schemars(extend("exclusiveMinimum" = 0))]
    pub clip: f64,
    /// Decay of the weights' exponential moving average; none evaluates the weights themselves.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schemars(extend("exclusiveMinimum" = 0, "exclusiveMaximum" = 1))]
    pub ema: Option<f64>,
    /// Batches of a step, each of the stage's tuples, whose gradients are averaged: a larger batch in the memory of
    /// one. Processes of one run share them.
    #[serde(default = "one")]
    #[schemars(range(min = 1, max = MOST_VIEWS))]
    pub accumulate: usize,
}

/// Default batches of a step.
fn one() -> usize {
    1
}

impl Default for OptimizerConfig {
    fn default() -> Self {
        Self { beta1: 0.9, beta2: 0.99, epsilon: 1e-8, weight_decay: 0.02, clip: 1.0, ema: Some(0.998), accumulate: 1 }
    }
}

/// Source of the cameras of a pass.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum CameraMode {
    /// The network's own.
    Predicted,
    /// The data's.
    Given,
}

impl std::fmt::Display for CameraMode {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            Self::Predicted => "predicted",
            Self::Given => "given",
        })
    }
}

impl std::str::FromStr for CameraMode {
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
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, bound = "")]
#[schemars(bound = "")]
pub struct StageConfig<R: Recipe> {
    /// Its name in logs.
    pub name: String,
    /// Optimizer steps.
    #[schemars(range(max = MOST))]
    pub steps: usize,
    /// Tuples per step.
    #[schemars(range(max = MOST_VIEWS))]
    pub tuples: usize,
    /// Peak learning rate.
    #[schemars(extend("exclusiveMinimum" = 0))]
    pub rate: f64,
    /// Steps of linear warm-up.
    #[schemars(range(max = MOST))]
    pub warmup: usize,
    /// Where the cosine of the learning rate ends, as a fraction of the peak.
    #[schemars(range(min = 0.0, max = 1.0))]
    pub floor: f64,
    /// Parts of the network that stay as they are, by the beginnings of their parameters' names: camera_head,
    /// aggregator.patch_embed.
    #[serde(default)]
    pub frozen: Vec<String>,
    /// True if transformer blocks are computed again on the way back, in place of keeping what they computed: the same
    /// result with less memory and more time.
    #[serde(default)]
    pub recompute: bool,
    /// The model's settings in this stage.
    pub model: R::Stage,
    /// Weights of the losses; 0 leaves a loss out.
    pub losses: R::Losses,
}

/// Output while training. None of it changes the result.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct OutputConfig {
    /// Steps between lines of metrics.jsonl.
    #[schemars(range(min = 1, max = MOST))]
    pub log_every: usize,
    /// Steps between checkpoints.
    #[schemars(range(min = 1, max = MOST))]
    pub checkpoint_every: usize,
    /// Steps between sample pictures.
    #[schemars(range(min = 1, max = MOST))]
    pub sample_every: usize,
}

impl Default for OutputConfig {
    fn default() -> Self {
        Self { log_every: 10, checkpoint_every: 500, sample_every: 500 }
    }
}

impl<R: Recipe> StageConfig<R> {
    /// A stage of one tuple a step: warm-up over a fifteenth of it, then a cosine down to a tenth of `rate`.
    pub fn new(name: &str, steps: usize, rate: f64, losses: R::Losses) -> Self
    where
        R::Stage: Default,
    {
        let (name, warmup) = (name.into(), steps / 15);
        Self {
            name,
            steps,
            tuples: 1,
            rate,
            warmup,
            floor: 0.1,
            frozen: Vec::new(),
            recompute: false,
            model: R::Stage::default(),
            losses,
        }
    }
}

impl<R: Recipe> Config<R> {
    /// A configuration with this network and these stages, and defaults otherwise.
    pub fn new(preset: &str, model: R::Model, stages: Vec<StageConfig<R>>, evaluation: R::Evaluation) -> Self {
        Self {
            architecture: R::ARCHITECTURE.into(),
            preset: preset.into(),
            seed: 0,
            threads: None,
            init: None,
            model,
            data: DataConfig::default(),
            optimizer: OptimizerConfig::default(),
            stages,
            output: OutputConfig::default(),
            evaluation,
        }
    }

    /// The configuration of a preset.
    ///
    /// # Errors
    /// When there is no such preset; the message lists the existing ones.
    pub fn preset(name: &str) -> Result<Self, Error> {
        R::preset(name).ok_or_else(|| {
            let hint = weaver_run::settings::nearest(name, R::PRESETS.iter().copied())
                .map_or(String::new(), |n| format!("; did you mean `{n}`?"));
            let known = R::PRESETS.join(", ");
            Error::Config(Wrong::invalid("preset", format!("expected one of {known}, found `{name}`{hint}")))
        })
    }

    /// Resolves defaults < preset < file < settings (`key=value`, the key a dotted path).
    ///
    /// The file may name the preset; a preset given here wins.
    ///
    /// # Errors
    /// When the file cannot be read, or a key or value is wrong.
    pub fn resolve(preset: Option<&str>, file: Option<&Path>, settings: &[String]) -> Result<Self, Error> {
        let mut table = file.map(weaver_run::settings::read_table).transpose()?.unwrap_or_default();
        let source = weaver_run::settings::source(file, settings);
        if let Some(setting) = settings.iter().find(|s| s.split('=').next().is_some_and(|key| key.trim() == "preset")) {
            let message = "expected a preset to be chosen by --preset or in a file: all other values start from it";
            return Err(Wrong::invalid(setting, format!("preset: {message}")).into());
        }
        let named = match table.remove("preset") {
            None => None,
            Some(Value::String(name)) => Some(name),
            Some(other) => {
                let message = format!("preset: expected string, found {} `{other}`", other.type_str());
                return Err(Wrong::invalid(&source, message).into());
            }
        };
        let mut layers = Layers::new(&Self::preset(preset.or(named.as_deref()).unwrap_or(R::PRESETS[0]))?)?;
        if let Some(path) = file {
            layers.merge(table, &path.display().to_string())?;
        }
        for setting in settings {
            layers.set(setting)?;
        }
        Self::settled(layers.finish(&source)?, &source)
    }

    /// Reads the resolved configuration of a run.
    ///
    /// # Errors
    /// When the file cannot be read, or is no configuration of this model.
    pub fn read(path: &Path) -> Result<Self, Error> {
        Self::from_toml(&weaver_io::read_text(path)?, &path.display().to_string())
    }

    /// Parses a resolved configuration; `source` names it in errors.
    ///
    /// # Errors
    /// When the text is not TOML, or a key or value is wrong.
    pub fn from_toml(text: &str, source: &str) -> Result<Self, Error> {
        Self::settled(weaver_run::settings::parse(text, source)?, source)
    }

    /// The configuration as TOML text.
    pub fn to_toml(&self) -> String {
        weaver_run::settings::to_toml(self).expect("a configuration is plain data")
    }

    /// The configuration as TOML text with documentation before every key; optional keys without a value are commented
    /// out.
    pub fn to_annotated_toml(&self) -> String {
        weaver_run::settings::annotate(self).expect("a configuration is plain data")
    }

    fn settled(mut config: Self, source: &str) -> Result<Self, Error> {
        R::settle(&mut config);
        config.check_combinations().map_err(|message| Wrong::invalid(source, message))?;
        Ok(config)
    }

    /// Steps of all stages.
    pub fn steps(&self) -> usize {
        self.stages.iter().map(|s| s.steps).sum()
    }

    /// Prolongs the last stage until there are `total` steps. The rate follows the longer stage's cosine from then on.
    ///
    /// # Errors
    /// When more steps are planned already.
    pub fn prolong(&mut self, total: usize) -> Result<(), Error> {
        let planned = self.steps();
        match self.stages.last_mut() {
            Some(last) if total >= planned => last.steps += total - planned,
            _ => {
                let message = format!("steps: expected at least the {planned} that are planned, found {total}");
                return Err(Error::Input(message));
            }
        }
        self.check()
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
}
