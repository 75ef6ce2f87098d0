//! A mixture of moving Gaussians trained on a film: a folder with experts, router, checkpoints, logs and a report.
//!
//! | file | content |
//! |---|---|
//! | `run.json` | what was asked for |
//! | `init.safetensors` | the numbers it began with, if it came out of another run |
//! | `checkpoint.safetensors` | everything needed to go on |
//! | `model.safetensors` | experts and router, once all stages are done |
//! | `metrics.jsonl` | losses |
//! | `summary.json`, `report.html` | how photos are met, strips over time, gates, curves |
//!
//! [`Run`] is such a training, [`RunSettings`] what is asked of it: stages one after the other, each of an expert, of the router, or of an expert
//! that is distilled. [`Run::pruned`] makes the numbers of a smaller run.

mod beginning;
mod error;
mod evaluate;
mod mixture;
mod moment;
mod objective;
mod optimizer;
mod prune;
mod report;
mod run;
mod settings;
mod show;
mod views;

pub use error::RunError;
pub use evaluate::{Evaluation, MotionScores, Quality, Scores};
pub use mixture::{Mixture, Pictures};
pub use prune::KeepBy;
pub use run::{Place, Run};
pub use settings::{DerivedFrom, ExpertKind, FilmSource, Preset, RunSettings, Stage};
pub use show::{COLOR_NAMES, COLORS, Strip};
pub use weaver_run::StepReport;

/// The example of the README, compiled and run.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
