//! metrics.jsonl: one JSON object per logged step.

use super::{Observer, StepReport};
use crate::Error;
use std::path::Path;
use weaver_io::Appender;

/// Appends every `every`-th step, and the first, to a JSON-lines file.
#[derive(Debug)]
pub struct MetricsLog {
    file: Appender,
    every: usize,
}

impl MetricsLog {
    /// Continues the log after `step` steps: lines of later steps, left by an interrupted session, are dropped.
    ///
    /// # Errors
    /// When the file cannot be read or written.
    pub fn open(path: &Path, step: usize, every: usize) -> Result<Self, Error> {
        if path.exists() {
            let kept: Vec<StepReport> = read_metrics(path)?.into_iter().filter(|r| r.step <= step).collect();
            let text: String = kept.iter().map(line).collect();
            weaver_io::write_text(path, &text)?;
        }
        Ok(Self { file: Appender::open(path)?, every: every.max(1) })
    }
}

fn line(report: &StepReport) -> String {
    let mut text = serde_json::to_string(report).expect("a report is plain data");
    text.push('\n');
    text
}

impl Observer for MetricsLog {
    fn step(&mut self, report: &StepReport) -> Result<(), Error> {
        if report.step == 1 || report.step.is_multiple_of(self.every) {
            self.file.append(line(report).as_bytes())?;
        }
        Ok(())
    }
}

/// Reads a log; an incomplete last line, as after a crash, is skipped.
///
/// # Errors
/// When the file cannot be read.
pub fn read_metrics(path: &Path) -> Result<Vec<StepReport>, Error> {
    Ok(weaver_io::read_text(path)?.lines().filter_map(|l| serde_json::from_str(l).ok()).collect())
}
