//! Tests of what a run leaves for its reader.

mod metrics_log;
mod page;
mod tensorboard;
