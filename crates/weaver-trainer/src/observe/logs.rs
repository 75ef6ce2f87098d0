//! metrics.jsonl and TensorBoard's event files.

use super::{Observer, StepReport};
use crate::Error;
use weaver_inference::RunFolder;
use weaver_report::{MetricsLog, TensorBoard};

/// Writes every `every`-th step, and the first, to the logs of a run folder.
#[derive(Debug)]
pub struct Logs {
    metrics: MetricsLog,
    board: TensorBoard,
    every: usize,
}

impl Logs {
    /// Continues the logs after `step` steps: lines of later steps, left by an interrupted session, are dropped. TensorBoard gets
    /// a new event file.
    ///
    /// # Errors
    /// When a file cannot be read or written.
    pub fn open(folder: &RunFolder, step: usize, every: usize) -> Result<Self, Error> {
        let metrics = MetricsLog::open(folder.metrics_path(), step)?;
        let board = TensorBoard::create(folder.events_path())?;
        Ok(Self { metrics, board, every: every.max(1) })
    }
}

impl Observer for Logs {
    fn step(&mut self, report: &StepReport) -> Result<(), Error> {
        if report.step != 1 && !report.step.is_multiple_of(self.every) {
            return Ok(());
        }
        self.metrics.append(report)?;
        let named = [
            ("loss", report.loss),
            ("rate", report.rate),
            ("gradient_norm", report.gradient_norm),
            ("gaussians_per_pixel", report.gaussians_per_pixel),
        ];
        let terms = report.terms.iter().map(|(name, value)| (format!("loss/{name}"), *value));
        let scalars: Vec<(String, f32)> = named.map(|(n, v)| (n.into(), v)).into_iter().chain(terms).collect();
        Ok(self.board.scalars(report.step, &scalars)?)
    }
}
