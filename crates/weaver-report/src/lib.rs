//! What a run leaves for its reader: a log of JSON lines, TensorBoard event files, and a page in one file.
//!
//! It knows neither models nor trainers: a [`MetricsLog`] takes any record with a step, [`TensorBoard`] names and numbers, and a
//! [`Page`] is built from headings, tables, pictures and [`curve`](Page::curve)s. Files are written by `weaver-io`, whose
//! errors name them.

mod curve;
mod metrics_log;
mod page;
mod tensorboard;

pub use metrics_log::{MetricsLog, read_metrics};
pub use page::{Page, Span};
pub use tensorboard::TensorBoard;
pub use weaver_io::{Error, Result};

/// The example of the README, compiled and run.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
