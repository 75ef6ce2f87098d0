//! Observers of training, and the report. None of them changes the result.

mod report;

pub use report::CURVES;
pub(crate) use report::page;

use crate::Error;
use weaver_run::StepReport;

/// Receives a report of every training step, whose scalars are each loss before its weight (`loss/NAME`), the learning
/// rate of the stage (`rate`), the global norm of the gradient before clipping (`gradient_norm`), and Gaussians per
/// context pixel (`gaussians_per_pixel`), 0 in a stage that renders nothing.
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
