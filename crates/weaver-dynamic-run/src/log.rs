//! The log of a run.

use crate::RunError;
use serde::{Deserialize, Serialize};
use std::path::Path;
use weaver_report::MetricsLog;

/// Records of a run, whatever its length.
const RECORDS: usize = 500;

/// Mean loss over some steps.
#[derive(Clone, Debug, Deserialize, Serialize)]
pub(crate) struct Record {
    /// The last of these steps, counted through all stages.
    pub step: usize,
    /// The stage's name.
    pub stage: String,
    /// The mean.
    pub loss: f64,
}

/// Writes a record now and then.
#[derive(Debug)]
pub(crate) struct Log {
    file: MetricsLog,
    sum: f64,
    count: usize,
}

impl Log {
    pub const FILE: &'static str = "metrics.jsonl";

    pub fn open(path: &Path, [done, _]: [usize; 2]) -> Result<Self, RunError> {
        Ok(Self { file: MetricsLog::open(path, done)?, sum: 0.0, count: 0 })
    }

    pub fn add(&mut self, [step, steps]: [usize; 2], stage: &str, loss: f32) -> Result<(), RunError> {
        self.sum += f64::from(loss);
        self.count += 1;
        if step.is_multiple_of(steps.div_ceil(RECORDS)) || step == steps {
            self.file.append(&Record { step, stage: stage.into(), loss: self.sum / self.count as f64 })?;
            (self.sum, self.count) = (0.0, 0);
        }
        Ok(())
    }
}
