//! Logged moments of a run.

use serde::{Deserialize, Serialize};
use weaver_fit::StepReport;

/// A logged moment: means over the steps since the last one.
#[derive(Clone, Copy, Debug, Default, Deserialize, PartialEq, Serialize)]
pub struct Record {
    /// Steps done.
    pub step: usize,
    /// Seconds since the run began.
    pub seconds: f64,
    /// The loss.
    pub loss: f64,
    /// Of the photos looked at, dB, at the size they were looked at.
    pub psnr: f64,
    /// Gaussians.
    pub gaussians: usize,
    /// Millions of Gaussians times pixels that were blended.
    pub pairs: f64,
}

impl Record {
    pub(crate) fn add(&mut self, report: &StepReport) {
        self.step = report.step;
        self.gaussians = report.gaussians;
        self.loss += report.loss;
        self.psnr += report.psnr;
        self.pairs += report.pairs as f64 / 1e6;
    }

    pub(crate) fn mean(&self, count: usize, seconds: f64) -> Self {
        let over = 1.0 / count as f64;
        let Self { loss, psnr, pairs, .. } = *self;
        Self { seconds, loss: loss * over, psnr: psnr * over, pairs: pairs * over, ..*self }
    }

    pub(crate) fn scalars(&self) -> [(&'static str, f32); 4] {
        let gaussians = self.gaussians as f64;
        let all = [("loss", self.loss), ("psnr", self.psnr), ("gaussians", gaussians), ("pairs", self.pairs)];
        all.map(|(name, value)| (name, value as f32))
    }
}
