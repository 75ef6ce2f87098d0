//! A fit of a capture on disk: a folder with the scene, cameras, checkpoints, logs and a report.
//!
//! | file | content |
//! |---|---|
//! | `run.json` | what was asked for, with the number of steps once it is known, and checksums of what was read |
//! | `init.ply` | the Gaussians it began with, if they were given or lie on surfaces that photos agree about |
//! | `checkpoint.safetensors` | everything needed to go on |
//! | `scene.ply` | the Gaussians; also in other formats if asked for, as `scene.spz` |
//! | `scene.wsz` | the Gaussians compressed, if the fit was made for it |
//! | `transforms.json`, `sparse/0` | the cameras, refined ones too, of the photos as they are on disk; the points, moved with them |
//! | `summary.json` | the outcome |
//! | `metrics.jsonl`, `events/` | logged values, also for TensorBoard |
//! | `report.html` | held-out photos beside renders, maps, curves |
//! | `view.html` | the scene to look at in a browser, with cameras and photos |
//! | `written.jsonl` | which of these files the fit wrote, and may replace |
//!
//! [`Run`] is such a fit, [`RunSettings`] what is asked of it, [`plan`](fn@plan) what it would take.

pub mod blocks;
mod compressed;
mod coverage;
mod error;
mod fitting;
mod judged;
mod keeping;
mod loaded;
mod looks;
mod maps;
mod matching;
mod outcome;
mod pace;
mod plan;
mod report;
mod results;
mod run;
mod settings;
mod sources;
mod start;
mod view;

pub use coverage::Coverage;
pub use error::RunError;
pub use matching::Matching;
pub use outcome::{Outcome, PoseChange, Views};
pub use pace::Pace;
pub use plan::{Plan, plan};
pub use report::CURVES;
pub use run::Run;
use settings::RunFile;
pub use settings::{ByPhotos, Initial, RunSettings};
pub use weaver_run::{Folder, StepReport};

/// The example of the README, compiled and run.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
