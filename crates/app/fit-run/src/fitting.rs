//! The optimization of a capture, as a job in steps.

use crate::loaded::Loaded;
use crate::{RunError, RunSettings};
use std::time::Instant;
use weaver_fit::{Fit, Judge};
use weaver_io::safetensors::Tensors;
use weaver_run::{Job, Log, Rhythm, Save, Scalar, StepReport};

/// A capture and the Gaussians that are fitted to it.
#[derive(Debug)]
pub(crate) struct Fitting {
    pub settings: RunSettings,
    pub capture: Loaded,
    pub judge: Judge,
    /// Seconds of earlier sessions.
    before: f64,
    started: Instant,
}

/// Records of a run, whatever its length.
const RECORDS: usize = 500;
/// Where a checkpoint has the seconds that were spent before it.
const SECONDS: &str = "seconds";

impl Fitting {
    pub fn new(settings: RunSettings, capture: Loaded, judge: Judge, started: Instant) -> Self {
        Self { settings, capture, judge, before: 0.0, started }
    }

    pub fn fit(&self) -> &Fit {
        &self.capture.fit
    }

    /// Seconds since the run began, those of earlier sessions included.
    pub fn seconds(&self) -> f64 {
        self.before + self.started.elapsed().as_secs_f64()
    }
}

impl Job for Fitting {
    type Error = RunError;

    fn steps(&self) -> [usize; 2] {
        [self.fit().steps_done(), self.fit().settings().steps]
    }

    fn step(&mut self) -> Result<StepReport, RunError> {
        let weaver_fit::StepReport { step, loss, psnr, gaussians, pairs, .. } = self.capture.fit.step()?;
        let scalars = vec![
            Scalar::mean("psnr", psnr),
            Scalar::last("gaussians", gaussians as f64),
            Scalar::mean("pairs", pairs as f64 / 1e6),
        ];
        Ok(StepReport { step, of: self.steps()[1], loss, scalars, ..StepReport::default() })
    }

    fn state(&mut self) -> Result<Tensors, RunError> {
        self.capture.fit.fetch()?;
        let mut state = self.fit().state();
        state.metadata.insert(SECONDS.into(), format!("{:.3}", self.seconds()));
        Ok(state)
    }

    fn restore(&mut self, state: &Tensors) -> Result<(), RunError> {
        self.capture.fit.restore(state)?;
        self.before = state.metadata.get(SECONDS).and_then(|s| s.parse().ok()).unwrap_or(0.0);
        Ok(())
    }

    fn rhythm(&self) -> Rhythm {
        Rhythm { log: Log::Means(RECORDS), save: Save::Seconds(self.settings.save_every) }
    }
}
