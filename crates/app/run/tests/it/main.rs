//! Tests of runs, of the files that they leave for their reader, and of settings.

mod metrics_log;
mod page;
mod run;
mod settings;
mod state;
mod tensorboard;
