//! Trains models that turn photos into Gaussians: configuration, stages, checkpoints that resume to the bit,
//! evaluation, logs and a report.
//!
//! A [`Recipe`] defines a model's configuration, construction, losses and prediction; [`Session`] does the rest for any
//! model, and a [`Registry`] finds recipes by name. The product's own recipe is in [`splatweaver`].

mod augmentation;
mod checkpoint;
mod config;
mod description;
mod dry_run;
mod error;
pub mod evaluate;
pub mod example;
mod figures;
mod initial;
mod looks;
pub mod losses;
pub mod observe;
pub mod photo;
mod recipe;
mod registry;
pub mod samples;
pub mod scenes;
mod session;
mod sources;
pub mod splatweaver;
mod taught;

pub use augmentation::Augmentation;
pub use checkpoint::TrainingState;
pub use config::{CameraMode, Config, DataConfig, OptimizerConfig, OutputConfig, SamplerKind, StageConfig};
pub use description::describe_results;
pub use dry_run::{DryRun, StageMemory};
pub use error::Error;
pub use evaluate::{Alignment, LookOf, Targets};
pub use example::Example;
pub use figures::{AlignedFigures, CameraFigures, Evaluation, LookFigures, SceneFigures, Summary, comparison};
pub use looks::LooksConfig;
pub use losses::Terms;
pub use observe::{CURVES, Observer};
pub use recipe::{LossSection, NoSettings, Recipe, Section, Step};
pub use registry::{
    ConfigSource, EvalOptions, MatchingOverride, ModelEntry, OpenRun, Registry, ResolvedConfig, Source, Training,
    claim_run, create_run, reclaim_run,
};
pub use session::{PendingStep, Session};
pub use sources::Sources;
pub use weaver_ranks::{Alone, Ranks};
pub use weaver_run::{Folder, StepReport};

/// The example of the README, compiled and run.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
