//! Learning-rate schedules.

use std::f64::consts::PI;

/// Linear warm-up, then half a cosine down to a floor, as a factor of the base rate.
///
/// ```
/// let schedule = weaver_nn::WarmupCosine { warmup: 10, total: 110, floor: 0.1 };
/// assert_eq!((schedule.factor(0), schedule.factor(9), schedule.factor(10)), (0.1, 1.0, 1.0));
/// assert!((schedule.factor(60) - 0.55).abs() < 1e-12 && (schedule.factor(500) - 0.1).abs() < 1e-12);
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct WarmupCosine {
    /// Steps of warm-up.
    pub warmup: u64,
    /// Step at which the floor is reached.
    pub total: u64,
    /// Rate at the end, as a fraction of the base rate.
    pub floor: f64,
}

impl WarmupCosine {
    /// The factor at step t, counted from 0: (t + 1) / warmup, then floor + (1 - floor) (1 + cos(pi p)) / 2 with
    /// p = (t - warmup) / (total - warmup) clamped to [0, 1].
    pub fn factor(&self, t: u64) -> f64 {
        if t < self.warmup {
            return (t + 1) as f64 / self.warmup as f64;
        }
        let length = self.total.saturating_sub(self.warmup).max(1);
        let progress = ((t - self.warmup) as f64 / length as f64).min(1.0);
        self.floor + (1.0 - self.floor) * (1.0 + (PI * progress).cos()) / 2.0
    }
}

/// The published schedule: a linear warm-up from a thousandth of the base rate, then half a cosine over `period` steps
/// down to an absolute rate, the same for all groups.
///
/// A group whose base rate is the final rate therefore keeps it after the warm-up.
///
/// ```
/// let schedule = weaver_nn::PublishedSchedule { warmup: 10, period: 100, final_rate: 1e-5 };
/// assert_eq!((schedule.rate(0, 1e-2), schedule.rate(10, 1e-2)), (1e-5, 1e-2));
/// assert!((schedule.rate(500, 1e-2) - 1e-5).abs() < 1e-12);
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PublishedSchedule {
    /// Steps of warm-up.
    pub warmup: u64,
    /// Length of the half cosine, counted from the end of the warm-up.
    pub period: u64,
    /// The rate at its end.
    pub final_rate: f64,
}

impl PublishedSchedule {
    /// The learning rate at step t, counted from 0, of a group with this base rate.
    pub fn rate(&self, t: u64, base: f64) -> f64 {
        if t < self.warmup {
            let start = 1e-3;
            return base * (start + (1.0 - start) * t as f64 / self.warmup as f64);
        }
        let progress = ((t - self.warmup) as f64 / self.period.max(1) as f64).min(1.0);
        self.final_rate + (base - self.final_rate) * (1.0 + (PI * progress).cos()) / 2.0
    }
}
