//! Time of a reconstruction, shared by matching and fit.

use crate::budget::{Budget, ENOUGH_ROUNDS};
use std::time::Instant;
use weaver_io::{Observe, duration};

/// The shortest time that a fit takes, minutes.
const SHORTEST: f64 = 0.05;
/// The least share of the time for the fit, however long matching took.
const SHARE: f64 = 0.25;
/// Passes through the photos below which more time is worth a remark.
const FEW_PASSES: f64 = 15.0;
/// Excess of a time that is worth a remark, seconds.
const SHOWN: f64 = 0.5;

/// The time of a reconstruction, which began at `start`.
#[derive(Clone, Copy, Debug)]
pub(crate) struct TimeBudget {
    start: Instant,
    minutes: f64,
}

impl TimeBudget {
    /// A time of `minutes` minutes from `start` on.
    pub fn new(start: Instant, minutes: f64) -> Self {
        Self { start, minutes }
    }

    /// Minutes that are left for the fit.
    pub fn of_fit(&self) -> f64 {
        (self.minutes - self.start.elapsed().as_secs_f64() / 60.0).max(SHARE * self.minutes).max(SHORTEST)
    }

    /// Remarks where cameras took so much of the time that the fit exceeds it.
    pub fn note_share(&self, observe: &mut dyn Observe) {
        let (spent, fit) = (self.start.elapsed().as_secs_f64(), 60.0 * self.of_fit());
        if spent + fit > 60.0 * self.minutes + SHOWN {
            observe.note(&format!("cameras took {spent:.0} s; the fit gets {fit:.0} s all the same"));
        }
    }

    /// Remarks how the time of a fit to so many photos will be spent, and where more of it would help by which `longer`
    /// request.
    pub fn note_plan(&self, budget: &Budget, photos: usize, longer: &str, observe: &mut dyn Observe) {
        let Budget { long_side, gaussians, steps } = *budget;
        let passes = steps as f64 / photos.max(1) as f64;
        let (all, gone) = (60.0 * self.minutes, self.start.elapsed().as_secs_f64());
        observe.note(&format!(
            "plan: {all:.0} s in all, {gone:.0} of them gone; about {steps} steps, {passes:.1} passes through {photos} photos of at most {long_side} pixels; {gaussians} Gaussians"
        ));
        if passes < FEW_PASSES {
            observe.note(&format!("a longer time ({longer}) makes a sharper scene: up to {ENOUGH_ROUNDS} passes pay"));
        }
    }

    /// Remarks at the end that all of it took longer.
    pub fn note_excess(&self, observe: &mut dyn Observe) {
        let (seconds, asked) = (self.start.elapsed().as_secs_f64(), 60.0 * self.minutes);
        if seconds > asked + SHOWN {
            let [all, more] = [seconds, seconds - asked].map(duration);
            observe.note(&format!("{all} in all, {more} more than was asked for"));
        }
    }
}
