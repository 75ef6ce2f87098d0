//! Observers of training: logs, TensorBoard, sample pictures, the report. None of them changes the result.

mod logs;
mod report;

pub use logs::Logs;
pub use report::write_report;

use crate::Error;
use serde::{Deserialize, Serialize};

/// What happened in one optimizer step.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct StepReport {
    /// Steps done, this one included, over all stages.
    pub step: usize,
    /// Name of the stage.
    pub stage: String,
    /// The weighted sum of the terms.
    pub loss: f32,
    /// Each loss before its weight, by name.
    pub terms: Vec<(String, f32)>,
    /// Learning rate of the stage at this step.
    pub rate: f32,
    /// Global norm of the gradient before clipping.
    pub gradient_norm: f32,
    /// Gaussians per context pixel; 0 in a stage that renders nothing.
    pub gaussians_per_pixel: f32,
    /// Seconds since the session began.
    pub seconds: f64,
}

/// Receives a report of every training step.
pub trait Observer {
    /// Called after every step.
    ///
    /// # Errors
    /// When its output cannot be written; training then stops, after a checkpoint.
    fn step(&mut self, report: &StepReport) -> Result<(), Error>;
}

impl<F: FnMut(&StepReport) -> Result<(), Error>> Observer for F {
    fn step(&mut self, report: &StepReport) -> Result<(), Error> {
        self(report)
    }
}
