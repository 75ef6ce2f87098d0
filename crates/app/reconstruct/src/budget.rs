//! The size of photos and the number of Gaussians that a time allows.

use crate::loaded::prepare;
use crate::plan::planned;
use crate::{ByPhotos, Error, Plan, RunSettings};
use std::ops::RangeInclusive;
use std::sync::Arc;
use weaver_data::posed::{self, CaptureCameras, PosedOptions};
use weaver_fit::{FitRasterizer, FitSettings, Rehearsal};

/// Passes through photos that are larger than the least: time for more of them is better spent on larger photos, by
/// docs/results/photos.md, and more gain nothing.
pub(crate) const ENOUGH_ROUNDS: usize = 40;
/// Photos that are loaded to time steps.
const FEW: usize = 12;
/// Part of the time that a timed run takes, and the most seconds of one. There are two.
const TIMED: (f64, f64) = (0.008, 2.0);
/// Gaussians of the two timed runs, for each pixel of a photo.
const DENSITIES: [f64; 2] = [0.05, 0.3];
/// Part of the time that is not the steps': loading, where Gaussians begin, results.
const BESIDE: f64 = 0.25;
/// Pixels that a run compares for each of its Gaussians: with more Gaussians it would end before they are in place,
/// with fewer it would blur.
const PIXELS: f64 = 4500.0;
/// The fewest Gaussians of a run.
const FEWEST: f64 = 5_000.0;
/// Part of the free memory that larger photos may be chosen for.
const MEMORY: f64 = 0.7;
/// Sides are multiples of this, pixels.
const GRAIN: usize = 16;

/// The work to do in a time.
#[derive(Clone, Debug)]
pub struct Work {
    /// The least and the largest longest side of photos, pixels.
    pub sides: RangeInclusive<usize>,
    /// Time of the fit, minutes.
    pub minutes: f64,
    /// The least passes through photos that are larger than the least side.
    pub rounds: usize,
}

/// The size of a run.
#[derive(Clone, Copy, Debug, Eq, PartialEq)]
pub struct Budget {
    /// Longest side of the photos, pixels.
    pub long_side: usize,
    /// The most Gaussians.
    pub gaussians: usize,
    /// Steps that the time is enough for, about.
    pub steps: usize,
}

/// Seconds of a step: so many for each pixel of a photo, and for each Gaussian.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Speed {
    pixel: f64,
    gaussian: f64,
    /// Seconds of everything that a run of any length does once.
    rounds: f64,
}

impl Budget {
    /// The largest photos with which the time is enough for the passes through them, and memory for the run; and as
    /// many Gaussians as the steps in that time can put in place, up to the usual number for photos of that size.
    ///
    /// `cameras` are the capture's, and `settings` the run's, whose number of Gaussians is not looked at. Two short
    /// runs are timed, with a few photos of the least side. Writes nothing.
    ///
    /// # Errors
    /// As [`Run::begin`](crate::Run::begin).
    pub fn of(
        settings: &RunSettings,
        cameras: &CaptureCameras,
        work: &Work,
        rasterizer: Arc<dyn FitRasterizer>,
    ) -> Result<Self, Error> {
        let seconds = 60.0 * work.minutes;
        let least = *work.sides.start();
        let at = |side: usize| RunSettings { long_side: Some(side), ..settings.clone() };
        let speed = Speed::of(at(least), cameras, (TIMED.0 * seconds).min(TIMED.1), rasterizer)?;
        let seconds = ((1.0 - BESIDE) * seconds - speed.rounds).max(0.0);
        let free = weaver_io::available_memory().map_or(f64::INFINITY, |free| free as f64);
        let budget = |side: usize| -> Result<(Self, bool), Error> {
            let plan = planned(&at(side), cameras)?;
            let usual = plan.usual();
            let found = speed.budget(side, &plan, usual.gaussians, seconds);
            let fit = FitSettings { gaussians: found.gaussians, ..usual };
            let bytes = planned(&RunSettings { fit, ..at(side) }, cameras)?.total() as f64;
            Ok((found, found.steps >= work.rounds * plan.training && bytes <= MEMORY * free))
        };
        // No photo has more pixels than at its own size.
        let [width, height] = planned(&at(*work.sides.end()), cameras)?.size;
        let most = width.max(height).min(*work.sides.end());
        for side in candidates(least, most) {
            let (found, enough) = budget(side)?;
            if enough {
                return Ok(found);
            }
        }
        Ok(budget(least)?.0)
    }
}

impl Budget {
    /// The largest photos that memory is enough for, with the usual number of Gaussians.
    ///
    /// # Errors
    /// As [`plan`](crate::plan()).
    pub(crate) fn largest_side(
        settings: &RunSettings,
        cameras: &CaptureCameras,
        sides: RangeInclusive<usize>,
    ) -> Result<usize, Error> {
        let free = weaver_io::available_memory().map_or(f64::INFINITY, |free| free as f64);
        let at = |side: usize| RunSettings { long_side: Some(side), ..settings.clone() };
        for side in candidates(*sides.start(), *sides.end()) {
            let fit = planned(&at(side), cameras)?.usual();
            if planned(&RunSettings { fit, ..at(side) }, cameras)?.total() as f64 <= MEMORY * free {
                return Ok(side);
            }
        }
        Ok(*sides.start())
    }
}

/// Longest sides above the least that are tried, the largest first.
fn candidates(least: usize, most: usize) -> impl Iterator<Item = usize> {
    (least + 1..=most).rev().filter(move |side| *side == most || side.is_multiple_of(GRAIN))
}

/// The most Gaussians of so many pixels that all steps compare.
pub(crate) fn most_gaussians(pixels: f64) -> f64 {
    (pixels / PIXELS).max(FEWEST)
}

impl Speed {
    /// Times two runs of about so many seconds each.
    fn of(
        settings: RunSettings,
        cameras: &CaptureCameras,
        seconds: f64,
        rasterizer: Arc<dyn FitRasterizer>,
    ) -> Result<Self, Error> {
        let plan = planned(&settings, cameras)?;
        let mut few = RunSettings { views: Some(settings.views.map_or(FEW, |views| views.min(FEW))), ..settings };
        few.by_photos.remove(&ByPhotos::Start);
        few.decide_lenses(&*rasterizer);
        // No others are decoded.
        let sample = PosedOptions { sample: few.views, ..few.posed_options() };
        let photos = posed::load(&few.capture, &sample)?;
        let mut timed = |density: f64| -> Result<(f64, Rehearsal), Error> {
            let gaussians = (density * plan.pixels()).max(FEWEST);
            few.fit = FitSettings { gaussians: gaussians as usize, ..plan.usual() };
            let mut job = prepare(&mut few.clone(), photos.clone(), None, rasterizer.clone())?;
            Ok((gaussians, Rehearsal::of(&mut job.fit, seconds)?))
        };
        let [(fewer, fast), (more, slow)] = [timed(DENSITIES[0])?, timed(DENSITIES[1])?];
        let gaussian = ((slow.step - fast.step) / (more - fewer).max(1.0)).max(0.0);
        let pixel = (fast.step - gaussian * fewer).max(0.0) / plan.pixels();
        Ok(Self { pixel, gaussian, rounds: slow.rounds })
    }

    /// As many steps as end in the time, with one Gaussian for each [`PIXELS`] that they compare: of `n` steps, each
    /// takes `pixel p + gaussian n p / PIXELS` seconds.
    fn budget(&self, long_side: usize, plan: &Plan, most: usize, seconds: f64) -> Budget {
        let pixels = plan.pixels();
        let (linear, square) = (self.pixel * pixels, self.gaussian * pixels / PIXELS);
        let steps = 2.0 * seconds / (linear + (linear * linear + 4.0 * square * seconds).sqrt()).max(1e-9);
        let gaussians = most_gaussians(steps * pixels).min(most as f64);
        let steps = seconds / (linear + self.gaussian * gaussians).max(1e-9);
        Budget { long_side, gaussians: gaussians as usize, steps: steps as usize }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use weaver_geometry::{Camera, Intrinsics, Pose};

    fn plan(width: usize) -> Plan {
        let intrinsics = Intrinsics { fx: 1.0, fy: 1.0, cx: 0.5, cy: 0.5 };
        let camera = Camera { pose: Pose::IDENTITY, intrinsics, width, height: width };
        Plan::of(&[(camera, false)], false, &FitSettings::default())
    }

    proptest! {
        /// Promise (scenes): the number of Gaussians follows from the time: the steps end in it, each Gaussian is met
        /// by enough pixels of them, and more time never means fewer.
        #[test]
        fn gaussians_follow_from_the_time(
            pixel in 1e-9_f64..1e-6, gaussian in 0.0_f64..1e-6, width in 64_usize..2000, seconds in 1.0_f64..10_000.0,
        ) {
            let (speed, plan) = (Speed { pixel, gaussian, rounds: 0.0 }, plan(width));
            let most = plan.usual().gaussians;
            let of = |seconds: f64| speed.budget(width, &plan, most, seconds);
            let Budget { gaussians, steps, .. } = of(seconds);
            let step = pixel * plan.pixels() + gaussian * gaussians as f64;
            prop_assert!(steps as f64 * step <= 1.0001 * seconds);
            prop_assert!(gaussians <= most && gaussians >= most.min(FEWEST as usize));
            let free = gaussians < most && gaussians > FEWEST as usize;
            let met = (steps + 1) as f64 * plan.pixels() / gaussians as f64;
            prop_assert!(!free || met > 0.99 * PIXELS, "{met} pixels for each Gaussian");
            prop_assert!(of(2.0 * seconds).gaussians >= gaussians && of(2.0 * seconds).steps >= steps);
        }
    }
}
