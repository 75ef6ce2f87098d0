//! A mixture of moving Gaussians trained on a film: a folder with experts, router, checkpoints, logs and a report.
//!
//! | file | content |
//! |---|---|
//! | `run.json` | the settings |
//! | `init.safetensors` | the initial parameters of a derived run |
//! | `checkpoint.safetensors` | everything for resuming |
//! | `model.safetensors` | experts and router, once all stages are done |
//! | `metrics.jsonl` | losses |
//! | `summary.json`, `report.html` | errors on photos, strips over time, gates, curves |
//!
//! [`Run`] is such a training, [`RunSettings`] its settings: stages one after the other, each of an expert, of the
//! router, or of an expert that is distilled. [`Run::pruned`] makes the parameters of a smaller run.
//!
//! ```rust
//! use std::sync::atomic::AtomicBool;
//! use weaver_dynamic::run::{ExpertKind, FilmSource, Preset, Run, RunSettings, Stage};
//!
//! let folder = tempfile::tempdir()?;
//! let settings = RunSettings {
//!     film: FilmSource::Procedural { seed: 1, size: [32, 24], shots: [3, 8] },
//!     experts: vec![ExpertKind::Keys, ExpertKind::Poly],
//!     preset: Preset::Tiny,
//!     gaussians: 200,
//!     all: false,
//!     stages: vec![
//!         Stage::Expert { index: 0, steps: 3 },
//!         Stage::Expert { index: 1, steps: 3 },
//!         Stage::Router { steps: 3 },
//!     ],
//!     temperature: 1.0,
//!     background_weight: 1.0,
//!     seed: 1,
//!     save_every: 60.0,
//!     derived_from: None,
//! };
//! let mut run = Run::create(&folder.path().join("run"), settings, None)?;
//! run.advance(&AtomicBool::new(false), |step| println!("{}: {}", step.stage, step.loss))?;
//! let evaluation = run.evaluate(|_, _| {})?;
//! run.report(&evaluation)?;
//! let scores = evaluation.held_out_cameras.expect("a camera is held out");
//! assert!(scores.oracle.psnr >= scores.experts[0].psnr);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

mod beginning;
mod error;
mod evaluate;
mod mixture;
mod moment;
mod objective;
mod optimizer;
mod prune;
mod report;
mod settings;
mod show;
mod training;
mod views;

pub use error::RunError;
pub use evaluate::{Evaluation, MotionScores, Quality, Scores};
pub use mixture::{Mixture, Pictures};
pub use prune::KeepBy;
pub use settings::{DerivedFrom, ExpertKind, FilmSource, Preset, RunSettings, Stage};
pub use show::{COLOR_NAMES, COLORS, Strip};
pub use training::{MODEL, Place, Run};
pub use weaver_run::StepReport;
