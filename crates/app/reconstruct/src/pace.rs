//! Time of a run, from a rehearsal.

use crate::fitting::Fitting;
use crate::loaded::load;
use crate::{Error, RunSettings};
use std::sync::Arc;
use std::time::Instant;
use weaver_fit::{FitRasterizer, Judge, Rehearsal};
use weaver_scene::Gaussians;

/// Seconds that the rehearsed steps take, about.
const REHEARSAL: f64 = 3.0;

/// Seconds of the parts of a run on this machine.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pace {
    /// Everything before the first step.
    pub loading: f64,
    /// The steps.
    pub steps: Rehearsal,
    /// Judging every photo at the end, and the report.
    pub results: f64,
}

impl Pace {
    /// Measures a run: loads the capture, finds where Gaussians begin, and does a short run of a few seconds. Writes
    /// nothing.
    ///
    /// # Errors
    /// As [`Run::begin`](crate::Run::begin).
    pub fn of(
        settings: &RunSettings,
        given: Option<&Gaussians>,
        rasterizer: Arc<dyn FitRasterizer>,
    ) -> Result<Self, Error> {
        let (started, mut settings) = (Instant::now(), settings.clone());
        let capture = load(&mut settings, given, rasterizer, None)?;
        let loading = started.elapsed().as_secs_f64();
        let mut job = Fitting::new(settings, capture, Judge::default(), started);
        let results = job.seconds_of_results()?.iter().sum();
        let steps = Rehearsal::of(&mut job.capture.fit, REHEARSAL)?;
        Ok(Self { loading, steps, results })
    }

    /// Seconds of a run of `steps` steps.
    pub fn total(&self, steps: usize) -> f64 {
        self.loading + self.steps.seconds(steps) + self.results
    }
}
