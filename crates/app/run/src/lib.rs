//! Long work in a folder: a [`Job`] in steps, and a [`Run`] of it that is logged, saved, stopped, and gone on with to
//! the same bits.
//!
//! A job is independent of files. It does a step, gives its [state](Job::state) as tensors and takes it back;
//! [`state`](mod@state) has parameters, averages and optimizers ready for that. The [`Folder`] holds settings,
//! checkpoint, log, summary and report under the same names for every command; only files that the same command wrote
//! are replaced in it. [`settings`] resolves settings from layers; a [`Page`] is built from headings, tables, pictures
//! and curves.

mod curve;
pub mod description;
mod error;
mod folder;
mod job;
mod metrics_log;
mod page;
mod record;
mod recorder;
mod rhythm;
pub mod settings;
pub mod state;
mod step_report;
mod tensorboard;
pub mod unit;
mod work_list;

pub use error::Error;
pub use folder::{Folder, Kind};
pub use job::{Job, Run, advance};
pub use metrics_log::{MetricsLog, read_metrics};
pub use page::{Page, Span};
pub use record::{Record, read_records};
pub use recorder::Recorder;
pub use rhythm::{Log, Rhythm, Save};
pub use step_report::{Scalar, StepReport};
pub use tensorboard::TensorBoard;
pub use work_list::{Work, WorkInput, WorkList};

/// The example of the README, compiled and run.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
