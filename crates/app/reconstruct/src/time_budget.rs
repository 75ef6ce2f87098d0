//! Time of a reconstruction, shared by matching and fit.

use std::time::Instant;
use weaver_io::{Observe, duration};

/// The shortest time that a fit takes, minutes.
const SHORTEST: f64 = 0.05;
/// The least share of the time for the fit, however long matching took.
const SHARE: f64 = 0.5;
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

    /// Remarks at the end that all of it took longer.
    pub fn note_excess(&self, observe: &mut dyn Observe) {
        let (seconds, asked) = (self.start.elapsed().as_secs_f64(), 60.0 * self.minutes);
        if seconds > asked + SHOWN {
            let [all, more] = [seconds, seconds - asked].map(duration);
            observe.note(&format!("{all} in all, {more} more than was asked for"));
        }
    }
}
