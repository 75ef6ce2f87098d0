//! Fits of one picture: by a number of Gaussians, or until the file has a length or quality.

use crate::read::failure;
use crate::results::{BITS, Judged, Method};
use std::ops::ControlFlow;
use std::path::Path;
use std::sync::atomic::Ordering;
use weaver_command::{Console, Failure, Interrupt, Progress};
use weaver_image::{Picture, fit};

/// Fits that look for a number of bytes or decibels, at most.
const TRIALS: usize = 6;
/// Decibels that doubling the Gaussians brings, about.
const DOUBLING: f64 = 1.5;

/// Fits of one picture.
pub struct Search<'a, 'b> {
    pub path: &'a Path,
    pub picture: &'a Picture,
    pub method: &'a Method,
    pub console: &'a mut Console<'b>,
    pub interrupt: &'a Interrupt,
}

impl Search<'_, '_> {
    fn stopped(&self) -> bool {
        self.interrupt.watch().load(Ordering::Relaxed)
    }

    /// The fit with so many Gaussians.
    pub fn trial(&mut self, count: usize) -> Result<Judged, Failure> {
        let (method, interrupt, console) = (self.method, self.interrupt, &mut *self.console);
        let mut progress = Progress::new("fit", 0, method.steps, console);
        let fitted = fit(self.picture, &method.settings(count), &mut |at| {
            progress.at(at.step, method.steps, || method.note(at.gaussians, at.loss), console);
            match interrupt.watch().load(Ordering::Relaxed) {
                true => ControlFlow::Break(()),
                false => ControlFlow::Continue(()),
            }
        });
        progress.finish();
        let judged = fitted.and_then(|fitted| Judged::new(self.path, self.picture, &fitted));
        judged.map_err(|error| failure(self.path, &error))
    }

    /// The largest trial of at most so many bytes.
    pub fn within(&mut self, bytes: usize) -> Result<Judged, Failure> {
        let mut best: Option<Judged> = None;
        let mut count = 8.0 * bytes as f64 / BITS;
        for _ in 0..TRIALS {
            let trial = self.trial(self.bounded(count))?;
            let found = trial.row.bytes;
            // Two parts in a thousand below, so that the next one is not above again.
            count = trial.row.gaussians as f64 * 0.998 * bytes as f64 / found as f64;
            let fits = found <= bytes;
            if fits && best.as_ref().is_none_or(|best| best.row.bytes < found) {
                best = Some(trial);
            }
            if self.stopped() || (fits && found as f64 > 0.99 * bytes as f64) {
                break;
            }
        }
        best.ok_or_else(|| Failure::message(format!("--bytes {bytes}: expected a length that a fit has, found none")))
    }

    /// The smallest trial of at least so many decibels.
    pub fn reaching(&mut self, decibels: f64) -> Result<Judged, Failure> {
        let mut best: Option<Judged> = None;
        let (mut count, mut highest) = (self.picture.gaussians_for(50.0) as f64, f64::NEG_INFINITY);
        for _ in 0..TRIALS {
            let trial = self.trial(self.bounded(count))?;
            let missing = decibels - trial.row.psnr;
            highest = highest.max(trial.row.psnr);
            count = trial.row.gaussians as f64 * ((missing + 0.05) / DOUBLING).clamp(-3.0, 3.0).exp2();
            let reached = missing <= 0.0;
            if reached && best.as_ref().is_none_or(|best| trial.row.bytes < best.row.bytes) {
                best = Some(trial);
            }
            if self.stopped() || (reached && missing > -0.1) {
                break;
            }
        }
        best.ok_or_else(|| {
            Failure::message(format!(
                "--psnr {decibels}: expected a fit that reaches it, found {highest:.2} dB at most"
            ))
        })
    }

    fn bounded(&self, count: f64) -> usize {
        (count as usize).clamp(1, self.picture.pixels())
    }
}
