//! Fits of one picture: for a number of Gaussians, or until the file has a length or quality.

use crate::command::read::failure;
use crate::command::results::{BITS, Judged, Method};
use crate::command::trace::Trace;
use crate::{Fit, ImageError, Picture};
use std::path::Path;
use std::sync::atomic::Ordering;
use weaver_command::{Console, Failure, Interrupt, Progress};

/// Most fits in a search for a number of bytes or decibels.
const TRIALS: usize = 6;
/// Approximate gain of decibels from twice the Gaussians.
const DOUBLING: f64 = 1.5;

/// Wanted size of a file.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Goal {
    /// This number of Gaussians.
    Gaussians(usize),
    /// At most this number of bytes.
    Bytes(usize),
    /// At least this number of decibels.
    Decibels(f64),
}

impl Goal {
    /// The most fits of a search.
    pub fn trials(self) -> usize {
        if matches!(self, Self::Gaussians(_)) { 1 } else { TRIALS }
    }
}

/// Fits of one picture.
pub struct Search<'a, 'b> {
    pub path: &'a Path,
    pub picture: &'a Picture,
    pub method: &'a Method,
    pub console: &'a mut Console<'b>,
    pub interrupt: &'a Interrupt,
    /// Log of the fits for a live page.
    pub trace: Option<Trace<'a>>,
    /// Fit at which the search was stopped before its end.
    pub early: Option<String>,
}

impl Search<'_, '_> {
    fn stopped(&self) -> bool {
        self.interrupt.watch().load(Ordering::Relaxed)
    }

    /// The fit that meets a goal.
    pub fn reaching(&mut self, goal: Goal) -> Result<Judged, Failure> {
        match goal {
            Goal::Gaussians(count) => self.trial(count),
            Goal::Bytes(bytes) => self.within(bytes),
            Goal::Decibels(decibels) => self.at_least(decibels),
        }
    }

    /// The fit with `count` Gaussians.
    fn trial(&mut self, count: usize) -> Result<Judged, Failure> {
        let named = |error: ImageError| failure(self.path, &error);
        let steps = self.method.steps;
        let mut progress = Progress::new("fit", 0, steps, self.console);
        if let Some(trace) = &mut self.trace {
            trace.begin();
        }
        let mut fit = Fit::new(self.picture, &self.method.settings(count)).map_err(named)?;
        while !fit.is_done() {
            let at = fit.step(self.picture).map_err(named)?;
            progress.at(at.step, steps, || self.method.note(at.gaussians, at.loss), self.console);
            if let Some(trace) = &mut self.trace {
                trace.record(at, fit.state())?;
            }
            if self.stopped() && !fit.is_done() {
                self.early = Some(format!("step {} of {steps}", at.step));
                break;
            }
        }
        progress.finish();
        let judged = fit.finish(self.picture).and_then(|fitted| Judged::new(self.path, self.picture, &fitted));
        judged.map_err(named)
    }

    /// The largest trial of at most `bytes` bytes.
    fn within(&mut self, bytes: usize) -> Result<Judged, Failure> {
        let mut best: Option<Judged> = None;
        let mut count = 8.0 * bytes as f64 / BITS;
        for number in 1..=TRIALS {
            let trial = self.trial(self.bounded(count))?;
            let found = trial.row.bytes;
            // Two parts in a thousand below the estimate, so that the next file is not too long again.
            count = trial.row.gaussians as f64 * 0.998 * bytes as f64 / found as f64;
            let fits = found <= bytes;
            if fits && best.as_ref().is_none_or(|best| best.row.bytes < found) {
                best = Some(trial);
            }
            let reached = fits && found as f64 > 0.99 * bytes as f64;
            if self.ends(reached, number) {
                break;
            }
        }
        best.ok_or_else(|| self.missed(format!("--bytes {bytes}: expected a length that a fit has, found none")))
    }

    /// The smallest trial of at least `decibels` decibels.
    fn at_least(&mut self, decibels: f64) -> Result<Judged, Failure> {
        let mut best: Option<Judged> = None;
        let (mut count, mut highest) = (self.picture.gaussians_for(50.0) as f64, f64::NEG_INFINITY);
        for number in 1..=TRIALS {
            let trial = self.trial(self.bounded(count))?;
            let missing = decibels - trial.row.psnr;
            highest = highest.max(trial.row.psnr);
            count = trial.row.gaussians as f64 * ((missing + 0.05) / DOUBLING).clamp(-3.0, 3.0).exp2();
            let reached = missing <= 0.0;
            if reached && best.as_ref().is_none_or(|best| trial.row.bytes < best.row.bytes) {
                best = Some(trial);
            }
            if self.ends(reached && missing > -0.1, number) {
                break;
            }
        }
        best.ok_or_else(|| {
            self.missed(format!("--psnr {decibels}: expected a fit that reaches it, found {highest:.2} dB at most"))
        })
    }

    /// True if the search ends after the trial of this number, by reaching its goal or by interruption.
    fn ends(&mut self, reached: bool, number: usize) -> bool {
        let stopped = self.stopped();
        if stopped && !reached && number < TRIALS {
            self.early.get_or_insert_with(|| format!("fit {number} of at most {TRIALS}"));
        }
        stopped || reached
    }

    /// The failure of a search without a result: its interruption, or else `reason`.
    fn missed(&self, reason: String) -> Failure {
        let stopped =
            |at: &String| format!("{}: stopped at {at}, before a fit came near the goal", self.path.display());
        Failure::message(self.early.as_ref().map_or(reason, stopped))
    }

    fn bounded(&self, count: f64) -> usize {
        (count as usize).clamp(1, self.picture.pixels())
    }
}
