//! Training loop, checkpoints, evaluation and observers for SplatWeaver.

pub mod batch;
mod checkpoint;
mod config;
mod error;
pub mod evaluate;
mod evaluation;
pub mod infer;
mod objective;
pub mod observe;
mod predictor;
mod probe;
pub mod published;
mod run_folder;
pub mod samples;
pub mod scenes;
mod session;

pub use checkpoint::Checkpoint;
pub use config::{
    BudgetForm, Cameras, Config, DataConfig, EvaluationConfig, LossWeights, OptimizerConfig, OutputConfig, StageConfig,
};
pub use error::Error;
pub use evaluation::{Evaluation, SceneFigures, Summary};
pub use objective::{Objective, Terms};
pub use observe::{Observer, StepReport};
pub use predictor::{CameraSource, Prediction, Predictor, render};
pub use probe::{Rehearsal, StageMemory};
pub use run_folder::RunFolder;
pub use session::Session;

/// The example of the README, compiled and run.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
