//! Number of steps that fit into a time.

use crate::FitError;
use crate::fit::Fit;
use std::time::Instant;

/// Steps of the run that is timed, at least and at most, and the part of the time that it may take in between.
const STEPS: (usize, usize) = (30, 3000);
const PART: f64 = 0.05;
/// A rehearsal of no more than this times the least steps is not worth a second run.
const ENOUGH: usize = 2;
/// Part of the time that is held back, for no machine is equally fast all the time.
const RESERVE: f64 = 0.02;
/// Parts of a run whose times are kept apart.
const PARTS: usize = 10;

/// Time that a run takes, by a short one that leaves no trace.
///
/// The short run has the schedules of a long one: photos are as small, and Gaussians as many, in the same parts of it.
/// Periodic work, density control and the search for transients, happens as often in a run of any length and is kept
/// apart: in a run of 30 steps it is most of the time.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Rehearsal {
    /// Mean seconds of a step without density control and searches.
    pub step: f64,
    /// Seconds of all density control and searches of a run.
    pub rounds: f64,
    /// Shares of steps, and of the rest, that each tenth of a run takes.
    shares: [[f64; PARTS]; 2],
}

impl Rehearsal {
    /// Times of a run that is equally fast from its beginning to its end.
    pub fn even(step: f64, rounds: f64) -> Self {
        Self { step, rounds, shares: [[1.0 / PARTS as f64; PARTS]; 2] }
    }

    /// Times a run of about so many seconds, 30 to 3000 steps.
    ///
    /// # Errors
    /// As [`Fit::step`].
    pub fn of(fit: &mut Fit, seconds: f64) -> Result<Self, FitError> {
        fit.fetch()?;
        // The first steps of a run are much shorter than the later ones: only a whole run, if a short one, shows how
        // many take the time.
        let short = Self::of_steps(fit, STEPS.0)?;
        let steps = fit.agreed(short.steps_in(seconds)).min(STEPS.1);
        if steps > ENOUGH * STEPS.0 { Self::of_steps(fit, steps) } else { Ok(short) }
    }

    /// Seconds of so many steps.
    ///
    /// ```
    /// let rehearsal = weaver_fit::Rehearsal::even(0.25, 5.0);
    /// assert_eq!(rehearsal.seconds(100), 30.0);
    /// assert_eq!(rehearsal.steps_in(30.0), 100);
    /// assert_eq!(rehearsal.steps_in(1.0), 0);
    /// ```
    pub fn seconds(&self, steps: usize) -> f64 {
        self.rounds + steps as f64 * self.step
    }

    /// Number of steps in so many seconds.
    pub fn steps_in(&self, seconds: f64) -> usize {
        ((seconds - self.rounds) / self.step.max(1e-6)) as usize
    }

    /// Seconds between two parts of a run of so many steps: of its steps, and of density control and searches.
    ///
    /// ```
    /// let rehearsal = weaver_fit::Rehearsal::even(0.25, 5.0);
    /// assert_eq!(rehearsal.between(0.25, 0.5, 100).map(f64::round), [6.0, 1.0]);
    /// ```
    pub fn between(&self, from: f64, to: f64, steps: usize) -> [f64; 2] {
        // The share of the run before a part of it: whole tenths, and a part of one.
        let before = |shares: &[f64; PARTS], part: f64| -> f64 {
            let within = |tenth: usize| (part * PARTS as f64 - tenth as f64).clamp(0.0, 1.0);
            shares.iter().enumerate().map(|(tenth, share)| share * within(tenth)).sum()
        };
        let [steps_share, rounds_share] = self.shares.map(|shares| before(&shares, to) - before(&shares, from));
        [steps_share * self.step * steps as f64, rounds_share * self.rounds]
    }

    /// Times a run of so many steps, which leaves no trace.
    fn of_steps(fit: &mut Fit, steps: usize) -> Result<Self, FitError> {
        fit.without_a_trace(|fit| Self::timed(fit, steps))
    }

    fn timed(fit: &mut Fit, steps: usize) -> Result<Self, FitError> {
        // The first step meets cold memory.
        fit.step()?;
        fit.settings.steps = steps;
        (fit.step, fit.since) = (0, 0);
        let mut seconds = [[0.0; PARTS]; 2];
        while fit.step < steps {
            let tenth = fit.step * PARTS / steps;
            let start = Instant::now();
            fit.step()?;
            let rounds = fit.timings.rounds().as_secs_f64();
            seconds[0][tenth] += start.elapsed().as_secs_f64() - rounds;
            seconds[1][tenth] += rounds;
        }
        let sums = seconds.map(|tenths| tenths.iter().sum::<f64>());
        let shares = [0, 1].map(|i| seconds[i].map(|tenth| if sums[i] > 0.0 { tenth / sums[i] } else { 0.0 }));
        Ok(Self { step: sums[0] / steps as f64, rounds: sums[1], shares })
    }
}

impl Fit {
    /// Does work from the first step on, and is then as before.
    pub(crate) fn without_a_trace<T>(
        &mut self,
        work: impl FnOnce(&mut Self) -> Result<T, FitError>,
    ) -> Result<T, FitError> {
        let of_scene = (self.population.clone(), self.statistics.clone(), self.settings.clone());
        let of_photos = (self.exposures.clone(), self.poses.clone(), self.transients.clone());
        let moment = (self.step, self.since);
        (self.step, self.since) = (0, 0);
        let result = work(self);
        (self.population, self.statistics, self.settings) = of_scene;
        (self.exposures, self.poses, self.transients) = of_photos;
        (self.step, self.since) = moment;
        self.changed();
        result
    }
}

/// Number of steps that a fit can do in so many seconds, the [rehearsal](Rehearsal) included, which takes 5 % of them.
/// At least 1.
///
/// # Errors
/// As [`Fit::step`].
pub fn steps_in(fit: &mut Fit, seconds: f64) -> Result<usize, FitError> {
    Ok(in_time(fit, seconds)?.0)
}

/// [`steps_in`], and the rehearsal behind it.
///
/// # Errors
/// As [`Fit::step`].
pub fn in_time(fit: &mut Fit, seconds: f64) -> Result<(usize, Rehearsal), FitError> {
    let start = Instant::now();
    let rehearsal = Rehearsal::of(fit, PART * seconds)?;
    let left = (1.0 - RESERVE) * seconds - start.elapsed().as_secs_f64();
    // All processes make the steps that the first one has time for.
    Ok((fit.agreed(rehearsal.steps_in(left)).max(1), rehearsal))
}
