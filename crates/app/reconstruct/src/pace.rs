//! Time of a run, from a rehearsal.

use crate::fitting::Fitting;
use crate::loaded::{load, prepare};
use crate::plan::planned;
use crate::{ByPhotos, Error, RunSettings};
use std::ops::RangeInclusive;
use std::sync::Arc;
use std::time::Instant;
use weaver_data::posed::{self, CaptureCameras, PosedOptions};
use weaver_fit::{FitRasterizer, Judge, Rehearsal};
use weaver_scene::Gaussians;

/// Seconds that the rehearsed steps take, about.
const REHEARSAL: f64 = 3.0;
/// Photos that are loaded to time steps alone.
const FEW: usize = 12;
/// Part of the time that is not the steps': loading, where Gaussians begin, results.
const BESIDE: f64 = 0.2;
/// Part of the free memory that larger photos may be chosen for.
const MEMORY: f64 = 0.7;
/// Sides are multiples of this, pixels.
const GRAIN: f64 = 16.0;

/// Longest sides that photos may have, and the work to be done in a time.
#[derive(Clone, Debug)]
pub struct Sides {
    /// The least and the largest longest side, pixels.
    pub range: RangeInclusive<usize>,
    /// Time of the fit.
    pub minutes: f64,
    /// The least passes through the photos within the time.
    pub rounds: usize,
}

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
        let capture = load(&mut settings, given, rasterizer)?;
        let loading = started.elapsed().as_secs_f64();
        let mut job = Fitting::new(settings, capture, Judge::default(), started);
        let results = job.seconds_of_results()?.iter().sum();
        let steps = Rehearsal::of(&mut job.capture.fit, REHEARSAL)?;
        Ok(Self { loading, steps, results })
    }

    /// The largest allowed longest side of photos at which the time is enough for the passes through them, and memory
    /// for the run.
    ///
    /// `cameras` are the capture's, and `settings` the run's. Steps are timed with a few photos of the least side, and
    /// scaled by the number of pixels. Nothing is timed where photos are no larger than the least side. Writes nothing.
    ///
    /// # Errors
    /// As [`Run::begin`](crate::Run::begin).
    pub fn long_side(
        settings: &RunSettings,
        cameras: &CaptureCameras,
        sides: Sides,
        rasterizer: Arc<dyn FitRasterizer>,
    ) -> Result<usize, Error> {
        let Sides { range, minutes, rounds } = sides;
        let (least, most) = range.into_inner();
        let at = |side: usize| planned(&RunSettings { long_side: Some(side), ..settings.clone() }, cameras);
        let [small, large] = [at(least)?, at(most)?];
        if small.size == large.size {
            return Ok(least);
        }
        let mut few = RunSettings {
            long_side: Some(least),
            views: Some(settings.views.map_or(FEW, |views| views.min(FEW))),
            by_photos: ByPhotos { start: false, ..settings.by_photos },
            fit: small.usual(),
            ..settings.clone()
        };
        // No others are decoded.
        let sample = PosedOptions { sample: few.views, ..few.posed_options() };
        let photos = posed::load(&few.capture, &sample)?;
        let mut job = prepare(&mut few, photos, None, rasterizer)?;
        let seconds = Rehearsal::of(&mut job.fit, REHEARSAL)?.seconds(rounds * small.training);
        let in_time = least as f64 * (60.0 * minutes * (1.0 - BESIDE) / seconds).sqrt();
        let largest = RunSettings { long_side: Some(most), fit: large.usual(), ..settings.clone() };
        let bytes = planned(&largest, cameras)?.total();
        let free = weaver_io::available_memory().map_or(f64::INFINITY, |free| free as f64);
        let in_memory = most as f64 * (MEMORY * free / bytes as f64).sqrt();
        let side = (in_time.min(in_memory) / GRAIN).floor() * GRAIN;
        Ok((side as usize).clamp(least, most))
    }

    /// Seconds of a run of `steps` steps.
    pub fn total(&self, steps: usize) -> f64 {
        self.loading + self.steps.seconds(steps) + self.results
    }
}
